"""Map walks on the device: recorded as they are walked, with advice on the way, and then made into a map."""
