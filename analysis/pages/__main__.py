"""Write the pages of docs/ that follow from the committed tables: `python -m analysis.pages`."""

from analysis.pages import choosing, findings

for page in (choosing, findings):
    page.write()
    print(page.PAGE)
