"""A walk on disk: what the loop read and decided, as MCAP files that Foxglove and Lichtblick open as they are.

``tap`` listens between the loop and its surroundings; ``recorder`` takes what it hears off the loop's hands; ``parts``
writes it to files that rotate; ``messages`` and ``foxglove`` say in which form (``channels``: the table of all of
them); ``exact`` keeps values to the last bit. ``reading`` opens such a file with care, and ``replay`` lets the loop
run again on what it read then. The page is docs/recording.md.
"""
