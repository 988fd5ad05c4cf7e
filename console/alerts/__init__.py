"""Alerts: what somebody who watches must notice, and what was heard of a device around it."""
