"""A simulated building, its sensors with their noise, and the people who walk in it. Never imported by navcore."""
