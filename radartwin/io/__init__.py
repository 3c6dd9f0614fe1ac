"""Files, locks, untrusted input, worker processes, progress and the chat client. Every package may import this one."""
