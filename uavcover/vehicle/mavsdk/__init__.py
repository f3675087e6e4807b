"""The second client: MAVSDK's transfers and commands behind the calls of our own client."""
