"""Which parts of the simulation model a scene needs: the choice by simulator=auto, its run times, and the effect of each setting."""
