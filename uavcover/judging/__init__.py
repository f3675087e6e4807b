"""What a flight proved: coverage, safety and gaps from the flown track. Never imports the planner."""
