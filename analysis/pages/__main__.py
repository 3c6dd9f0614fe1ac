"""Write the pages that follow from the committed tables: `python -m analysis.pages`."""

from analysis.pages import choosing, findings, paper_tables, readme

for page in (choosing, findings, paper_tables, readme):
    page.write()
    print(page.PAGE)
