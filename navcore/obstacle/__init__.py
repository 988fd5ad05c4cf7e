"""Which directions are walkable, from the depth image (the paper's reference [13])."""
