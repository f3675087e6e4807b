"""What a route costs and whether it may be flown; from routes to missions."""
