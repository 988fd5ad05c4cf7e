"""Navigation core: pure computations on frozen values.

No clock, no thread, no socket and no user interface live here; time comes in as a stamp and everything after
localization is a function of values. See docs/architecture.md.
"""
