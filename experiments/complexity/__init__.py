"""Experiments on which parts of the simulation model a scene needs: the choice by simulator=auto, and run time and effect of each
setting.
"""
