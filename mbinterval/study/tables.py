"""Tables of a report, which can be sorted and copied (see ``page.js``), and its figures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape


def table(head: Sequence[str], rows: Iterable[Sequence[str]], caption: str) -> str:
    """Return an HTML table; cells are text, those that are figures stand to the right."""
    heads = "".join(
        f'<th scope="col"><button type="button" class="sort">{escape(text)}</button></th>'
        for text in head
    )
    lines = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
    return (
        '<div class="table"><button type="button" class="copy">Copy</button>'
        f"<table><caption>{escape(caption)}</caption><thead><tr>{heads}</tr></thead>"
        f"<tbody>{lines}</tbody></table></div>"
    )


def _cell(text: str) -> str:
    try:
        float(text.rstrip("%*").replace(",", "") or "text")
        kind = ' class="number"'
    except ValueError:
        kind = ""
    return f"<td{kind}>{escape(text)}</td>"


def figure(uri: str, size: tuple[int, int], alt: str, *told: str) -> str:
    """Return a picture as an HTML figure, ``size`` rows and columns large, with lines under it."""
    caption = "<br>".join(map(escape, told))
    return (
        f'<figure><img src="{uri}" alt="{escape(alt)}" width="{size[1]}" height="{size[0]}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def seconds_text(seconds: float) -> str:
    """Seconds with three digits, in milliseconds below one."""
    return f"{seconds:.3g} s" if seconds >= 1.0 else f"{1e3 * seconds:.3g} ms"
