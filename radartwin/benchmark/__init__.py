"""The public benchmark of radar simulators: frozen problems with independent answers, the score of a method, and the leaderboard."""
