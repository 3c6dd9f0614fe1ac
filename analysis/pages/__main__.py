"""Write the pages that follow from the committed tables: `python -m analysis.pages`."""

from analysis.pages import choosing, findings, readme

for page in (choosing, findings, readme):
    page.write()
    print(page.PAGE)
