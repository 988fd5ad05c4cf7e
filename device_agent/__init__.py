"""The process on the glasses: sensors in, guidance, cues out, and a link to the console that it can do without."""
