"""SLAM: building the virtual blind road, and locating the walker on it (paper IV-A)."""


def warm_up() -> None:
    """Compile all kernels of mapping and localization; they are kept on disk."""
    from navcore.slam import rehearsal

    rehearsal.warm_up()
