"""What is wrong, or may be, with a site and its PoI-graph, before somebody is led by it."""
