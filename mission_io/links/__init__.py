"""The links themselves: datagrams over UDP, and frames over what carries a stream of bytes (TCP, a serial line)."""
