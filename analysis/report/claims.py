"""Write the report's summary: the number of verdicts of each table, and every claim with its verdict and a link to its table row."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from html import escape

from analysis.report.content import FAILED, MISSING, STALE, Claim, Section, figure
from analysis.tables import slug
from radartwin.runs.experiment import LIMITS, VERDICTS

ORDER = (*VERDICTS, *LIMITS)
_HEADS = {"verdict": "", "claim": "", "metric": "", "value": ' class="number"', "paper": "", "n": ' class="number"'}


def summary(sections: Sequence[Section]) -> str:
    """Return the HTML of the report's summary: the number of claims with each verdict, the absent tables, and the list of claims."""
    present = [section for section in sections if not section.absent]
    found = [claim for section in present for claim in section.claims]
    count = Counter(claim.verdict for claim in found)
    rows = sum(len(section.rows) for section in present)
    told = f"{len(present)} of {len(sections)} tables are here. Of their {rows} rows {len(found)} state a claim."
    cards = "".join(f'<li class="{slug(v)}"><strong>{count[v]}</strong> {v}</li>' for v in ORDER if count[v])
    return f'<p>{told}</p>\n<ul class="cards" data-filter="claims">{cards}</ul>\n{_absent(sections)}{_tables(present)}{_claims(found)}'


def _absent(sections: Sequence[Section]) -> str:
    lines = []
    for state in (FAILED, STALE, MISSING):
        told = [
            f'<a href="#{s.table.name}">{escape(s.table.title)}</a>{f" (<code>{escape(s.error)}</code>)" if s.error else ""}'
            for s in sections
            if s.absent == state
        ]
        if told:
            lines.append(f'<p class="absent"><strong>{state}</strong>: {", ".join(told)}</p>')
    return "\n".join(lines) + "\n" if lines else ""


def _tables(present: Sequence[Section]) -> str:
    rows = "\n".join(
        f'<tr><th scope="row"><a href="#{s.table.name}">{escape(s.table.title)}</a></th>'
        + "".join(
            f'<td class="number {slug(verdict) if s.verdicts[verdict] else ""}">{s.verdicts[verdict] or "–"}</td>' for verdict in ORDER
        )
        + f'<td class="number">{len(s.rows)}</td></tr>'
        for s in present
    )
    head = "".join(f'<th scope="col" class="number">{text}</th>' for text in (*ORDER, "rows"))
    return (
        '<div class="scroll" role="region" tabindex="0" aria-label="claims by table"><table class="counts"><thead>'
        f'<tr><th scope="col">table</th>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody></table></div>\n'
    )


def _claims(found: Sequence[Claim]) -> str:
    head = "".join(f'<th scope="col"{kind}>{one}</th>' for one, kind in _HEADS.items())
    rows = "\n".join(_row(claim) for claim in sorted(found, key=lambda claim: claim.verdict not in ("contradicted", "misses")))
    return (
        '<h3 id="claims-title">Every claim</h3>\n<div class="scroll tall" role="region" tabindex="0" aria-labelledby="claims-title">\n'
        f'<table id="claims" data-tools><thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody></table></div>'
    )


def _row(claim: Claim) -> str:
    cells, name = claim.cells, claim.table.name
    low, value, high = (cells[one] for one in ("low", "value", "high"))
    interval = f"<small>{escape(figure(low))} to {escape(figure(high))}</small>" if low and high and (low, high) != (value, value) else ""
    where = f'<a href="#{name}-{claim.row}">{escape(claim.table.title)}</a>{f": {escape(claim.case)}" if claim.case else ""}'
    return (
        f'<tr class="{slug(claim.verdict)}"><td class="verdict">{claim.verdict}</td><td>{escape(claim.text)}<small>{where}</small></td>'
        f'<td>{escape(cells["metric"])}</td><td class="number">{escape(figure(value))}{interval}</td>'
        f"<td>{escape(cells['paper']) or '–'}</td>"
        f'<td class="number">{escape(cells["n"])}</td></tr>'
    )
