"""``vbr doctor``: is the device fit to lead somebody? Each check says what it found, and what to do."""
