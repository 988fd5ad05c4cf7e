"""The console: map editor, monitor and tuning, for a browser."""
