"""A strict reader of HTML: the tree's text by place, with every tag closed by its own end."""

import re
from dataclasses import dataclass, field
from html.parser import HTMLParser

VOID = {"meta", "link", "br", "img", "hr", "input", "col"}


@dataclass
class Element:
    tag: str
    attributes: dict[str, str]
    children: list["Element | str"] = field(default_factory=list)

    @property
    def text(self) -> str:
        parts = (part if isinstance(part, str) else part.text for part in self.children)
        return re.sub(r"[ \t\n\xa0]+", " ", "".join(parts)).strip()

    def all(self, tag: str) -> list["Element"]:
        found = [self] if self.tag == tag else []
        for child in self.children:
            if isinstance(child, Element):
                found += child.all(tag)
        return found

    def every(self) -> list["Element"]:
        found = [self]
        for child in self.children:
            if isinstance(child, Element):
                found += child.every()
        return found

    def by_id(self, name: str) -> "Element":
        return next(element for element in self.every() if element.attributes.get("id") == name)


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.root = Element("root", {})
        self.stack = [self.root]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        element = Element(tag, {name: value or "" for name, value in attrs})
        self.stack[-1].children.append(element)
        if tag not in VOID:
            self.stack.append(element)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.stack[-1].children.append(Element(tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        assert self.stack[-1].tag == tag, f"</{tag}> closes <{self.stack[-1].tag}>"
        self.stack.pop()

    def handle_data(self, data: str) -> None:
        self.stack[-1].children.append(data)


def read_html(html: str) -> Element:
    """Return the tree, or fail where a tag is not closed by its own end."""
    reader = _Reader()
    reader.feed(html)
    reader.close()
    assert reader.stack == [reader.root], f"never closed: {[e.tag for e in reader.stack[1:]]}"
    return reader.root


def table_cells(page: Element, caption_begins: str) -> list[list[str]]:
    """Return the body of the table whose caption begins with these words."""
    for table in page.all("table"):
        captions = table.all("caption")
        if captions and re.sub(r"^Table \d+\. ", "", captions[0].text).startswith(caption_begins):
            rows = table.all("tbody")[0].all("tr")
            cells = [[c for c in row.children if isinstance(c, Element)] for row in rows]
            return [[cell.text for cell in row] for row in cells]
    raise AssertionError(f"no table {caption_begins!r}")


def numbers_in(text: str) -> list[float]:
    """Return the numbers of a text; percentages stay percentages."""
    plain = text.replace("\N{MINUS SIGN}", "-").replace("\N{NARROW NO-BREAK SPACE}", "")
    return [float(found) for found in re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", plain)]
