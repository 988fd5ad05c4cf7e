"""navcore's localizer behind the device's port."""

from __future__ import annotations

from navcore.settings import LocalizationSettings, Settings
from navcore.site import Site
from navcore.slam.localizer import Localizer
from navcore.slam.slam_map import SlamMap
from navcore.types import CameraIntrinsics, Frame, Localization, LocalizationQuality


class MapLocalizer:
    """Locates frames in the map of a site."""

    def __init__(self, slam_map: SlamMap, intrinsics: CameraIntrinsics, settings: LocalizationSettings) -> None:
        self._map = slam_map
        self._intrinsics = intrinsics
        self._settings = settings
        self._localizer = Localizer(slam_map, intrinsics, settings)

    def locate(self, frame: Frame) -> Localization:
        """Return the pose of one frame."""
        return self._localizer.locate(frame)

    def use_features(self, fraction: float) -> None:
        """Look for this share of a frame's features from the next one on."""
        self._localizer.use_features(fraction)

    def apply(self, settings: Settings) -> None:
        """Run other settings from the next frame on; where they differ, the pose is found anew."""
        if settings.localization != self._settings:
            self._settings = settings.localization
            self._localizer = Localizer(self._map, self._intrinsics, self._settings)


class NoMap:
    """Stands in for a map that is still to be made: nowhere is known."""

    def locate(self, frame: Frame) -> Localization:
        """Return that the pose is lost."""
        return Localization(frame.stamp_s, LocalizationQuality.LOST, None, None, 0)

    def use_features(self, fraction: float) -> None:
        """No feature is looked for."""

    def apply(self, settings: Settings) -> None:
        """Nothing hangs on settings here."""


def make_localizer(site: Site, intrinsics: CameraIntrinsics, settings: Settings) -> MapLocalizer:
    """Return a localizer for a site and a camera. Raises SiteError where the site's map cannot be localized in."""
    return MapLocalizer(SlamMap.from_arrays(site.map_arrays), intrinsics, settings.localization)
