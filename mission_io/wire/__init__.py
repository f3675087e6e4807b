"""Bytes to frames to messages, and back. No sockets."""
