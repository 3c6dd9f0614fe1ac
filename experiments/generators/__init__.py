"""Scripts that write the shipped files: text anchors, recorded questions, repeatability."""
