"""A second client: MAVSDK conducts transfers and commands, on any link of ours, and we hear all that it hears."""
