"""The real navigation over a route without anyone walking: what would be said, where and when."""
