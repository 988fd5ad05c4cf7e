"""Geometry of the map, computed with Open3D: cleaner and smaller clouds, floor, walls, clearance, the floor plan.

Pure functions on arrays. Open3D takes a second to be imported, and is imported where it is first needed.
"""
