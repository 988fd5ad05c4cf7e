"""Kill -9 at moments that a seed chooses: of the console while people work with it, and of what a device keeps."""
