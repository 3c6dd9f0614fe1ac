"""Files, locks, untrusted input, progress and the chat client: what every package may use."""
