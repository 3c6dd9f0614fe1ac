"""Write the pages that follow from the committed tables: `python -m analysis.pages`."""

from analysis.pages import choosing, findings, paper_tables, readme
from radartwin.io import files

for page in (choosing, findings, paper_tables, readme):
    print(files.write_atomically(page.PAGE, page.text()))
choosing.draw()
