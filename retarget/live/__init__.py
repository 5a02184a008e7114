"""Live streams between the socket and the pipeline: who is listened to, when it was captured, when it is played."""
