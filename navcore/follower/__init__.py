"""Route following: sub-goal (Eqs. 1, 2), direction (Eqs. 3, 4), gate (Eq. 5)."""
