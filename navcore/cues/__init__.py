"""What the walker hears and sees."""
