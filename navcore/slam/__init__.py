"""SLAM: building the virtual blind road, and locating the walker on it (paper IV-A)."""
