"""The 3D scene: viser, mounted inside the console's own application."""
