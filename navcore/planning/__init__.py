"""PoI-graph and way finding (paper IV-A, IV-B)."""
