"""Missions over links that lose datagrams: this package's client and MAVSDK's, to equal vehicles on equal links."""
