"""Fuzzing of everything that comes as a file: the targets, how files are spoiled, and the drivers over both.

``targets`` names every reader of the product with small valid files; ``mutations`` spoils these; ``confined`` reads
them in a process that may take little memory and time; ``coverage_guided`` is the driver of ``.ci/fuzz``. The other
driver is ``tests/test_fuzzed_files.py``; it also reads what was found once.
"""
