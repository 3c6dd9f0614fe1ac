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
