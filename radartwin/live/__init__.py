"""Show a scene as a live page: drag the radar and the objects, and see the radar's answer at once (`radartwin view SCENE --live`)."""
