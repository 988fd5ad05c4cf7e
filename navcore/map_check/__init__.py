"""What is wrong, or may be, with a site and its PoI-graph, before somebody is led by it.

:mod:`navcore.map_check.evidence` is what the checks look at, :mod:`navcore.map_check.checker` has them all.
"""
