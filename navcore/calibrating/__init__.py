"""How the values of :mod:`navcore.calibration` are measured: pure computations on frames, pictures and readings."""
