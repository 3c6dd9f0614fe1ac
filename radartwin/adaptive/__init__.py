"""The option `simulator=auto` chooses the cheapest model of a scene that changes no feature by more than its repeatability limit."""
