"""If standard error is not a terminal, progress is printed as lines with the remaining time."""

from radartwin.io import progress


def test_lines_show_finished_items_and_remaining_time(monkeypatch, capsys):
    clock = iter([0.0, 6.0, 7.0, 12.0, 20.0])  # start, three steps of which the second comes soon after a line, end
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    now = [next(clock)]
    with progress.Progress().task("recordings", 4) as advance:
        for _ in range(3):
            now[0] = next(clock)
            advance()
        now[0] = next(clock)
    assert capsys.readouterr().err.splitlines() == [
        "recordings: 1/4, 18 s left", "recordings: 3/4, 4 s left", "recordings: 3 done in 20.0 s",
    ]  # fmt: skip
    monkeypatch.setattr(progress, "PLAIN_INTERVAL_S", 0.0)
    assert list(progress.Progress().over(iter("ab"), "letters")) == ["a", "b"]
    assert capsys.readouterr().err.splitlines()[:2] == ["letters: 1", "letters: 2"]  # without a total, there is no remaining time
    ahead = iter([600.0, 595.0, 300.0])
    now[0] = 0.0
    with progress.Progress().task("recordings", 9, lambda: next(ahead)) as advance:
        for now[0] in (10.0, 1740.0):  # the first step says little of the pace
            advance()
    assert [line.split(", ")[-1] for line in capsys.readouterr().err.splitlines()[:2]] == ["11 min left", "25 min left"]
