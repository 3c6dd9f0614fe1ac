"""From stored results to tables, figures and the report. Reads what experiments found; computes nothing of its own."""
