"""Assign materials to the surfaces of a scene: sources of material labels, questions to vision-language models, and scores of the
labels.
"""
