"""Open3D, imported on first use: it takes a second, and most of the console does without it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navcore.errors import MissingPackageError


def import_open3d() -> Any:
    """Import Open3D on first use. Raises MissingPackageError."""
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise MissingPackageError(
            "The geometry of the map needs Open3D: install the extra with `pip install 'virtual-blind-road[console]'`"
            " (and libusb-1.0-0, libgl1, libx11-6, libgomp1 from the system)."
        ) from error
    return open3d


def point_cloud(points_m: NDArray[Any]) -> Any:
    """Return points (n, 3), all of them finite, as Open3D takes them."""
    open3d = import_open3d()
    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(np.asarray(points_m, np.float64)))
