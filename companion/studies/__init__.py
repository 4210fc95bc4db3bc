"""Studies of the control law: the paper's results, theory, robustness, tuning."""
