"""Pages that are written from the committed tables, and a drawing of the test objects."""
