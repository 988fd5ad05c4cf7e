"""The walkers that are not looked at just now, in the scene of one client: small figures with their names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import viser

from console.live import Freshness, LiveDevice
from console.viewer import appearance as look
from console.viewer import meshes

MAX_OTHERS_COUNT = 30
"""More walkers than this are on the page Overview alone."""
LAST_SEEN_SHOWN_S = 600.0
_SCALE = 0.55
_NAME_Z_M = 1.1


@dataclass(slots=True)
class _Other:
    root: viser.FrameHandle
    body: viser.MeshHandle
    name: viser.LabelHandle


class OthersLayer:
    """Draws them for one client; the nodes are made when they are first needed, and kept."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._pool: list[_Other] = []

    def show(self, devices: Sequence[LiveDevice], now_s: float) -> None:
        """Draw these devices' walkers, grey and dated where they are old: where somebody was last is where to look."""
        shown = [
            (device, device.state.pose, device.freshness(now_s))
            for device in devices
            if device.state is not None
            and device.state.pose is not None
            and (device.age_s(now_s) or 0.0) < LAST_SEEN_SHOWN_S
        ][:MAX_OTHERS_COUNT]
        while len(self._pool) < len(shown):
            self._pool.append(self._made(len(self._pool)))
        for other, (device, pose, freshness) in zip(self._pool, shown, strict=False):
            is_live = freshness is Freshness.LIVE
            other.root.position = (pose[0], pose[1], 0.0)
            other.root.wxyz = meshes.quat_about_z(pose[3])
            other.root.visible = True
            other.body.color = look.WALKER if is_live else look.WALKER_STALE
            other.body.opacity = 1.0 if freshness in (Freshness.LIVE, Freshness.DELAYED) else 0.35
            age = "" if is_live else f", {freshness.value.upper()}, seen {look.age_text(device.age_s(now_s) or 0.0)}"
            other.name.text = f"{device.name}{age}"
        for other in self._pool[len(shown) :]:
            other.root.visible = False

    def _made(self, number: int) -> _Other:
        scene, name = self._client.scene, f"/others/{number}"
        figure = meshes.merged((meshes.walker_body(), 0.0), (meshes.ball(0.13), 1.60))
        return _Other(
            scene.add_frame(name, show_axes=False),
            scene.add_mesh_simple(
                f"{name}/body", figure.vertices_m, figure.faces, color=look.WALKER, side="double", scale=_SCALE,
                opacity=1.0, cast_shadow=False, receive_shadow=False,
            ),
            scene.add_label(f"{name}/name", "", position=(0.0, 0.0, _NAME_Z_M), anchor="bottom-center"),
        )  # fmt: skip
