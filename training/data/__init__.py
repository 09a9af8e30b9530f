"""What the models learn from and are judged on: measured, analytic and time-varying sources."""
