"""Blocks of a summary as Markdown, and back: a summary of a version that stored Markdown alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from markdown_it import MarkdownIt
from markdown_it.tree import SyntaxTreeNode

from pl_mc.report.document import Block, Bullets, Heading, Paragraph, TextTable
from pl_mc.report.text import markdown_table


def to_markdown(title: str, blocks: Iterable[Block], notes: Sequence[str] = ()) -> str:
    """A summary: its title, the blocks, and the notes as a list."""
    parts = [f"# {title}", *map(_block, blocks)]
    if notes:
        parts += ["Notes:", _bullets(notes)]
    return "\n\n".join(parts) + "\n"


def from_markdown(text: str) -> tuple[Block, ...]:
    """The blocks of a summary, without its title and notes."""
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    blocks = [
        block for node in SyntaxTreeNode(parser.parse(text)).children if (block := _of_node(node)) is not None
    ]
    for k, block in enumerate(blocks):
        if isinstance(block, Paragraph) and block.text == "Notes:":
            blocks = blocks[:k]
            break
    return tuple(blocks)


def _block(block: Block) -> str:
    if isinstance(block, Heading):
        return f"{'#' * block.level} {block.text}"
    if isinstance(block, Bullets):
        return _bullets(block.items)
    if isinstance(block, TextTable):
        return markdown_table(block.header, block.rows)
    return block.text


def _bullets(items: Iterable[str | Bullets], indent: str = "") -> str:
    return "\n".join(
        f"{indent}- {item}" if isinstance(item, str) else _bullets(item.items, f"{indent}  ") for item in items
    )


def _of_node(node: SyntaxTreeNode) -> Block | None:
    if node.type == "heading":
        return Heading(_text(node), level=int(node.tag[1:])) if node.tag != "h1" else None
    if node.type == "bullet_list":
        return _list(node)
    if node.type == "table":
        header, *bodies = node.children
        rows = tuple(tuple(_text(cell) for cell in row.children) for body in bodies for row in body.children)
        return TextTable(tuple(_text(cell) for cell in header.children[0].children), rows)
    return Paragraph(_text(node))


def _list(node: SyntaxTreeNode) -> Bullets:
    parts = [part for item in node.children for part in item.children]
    return Bullets(tuple(_list(part) if part.type == "bullet_list" else _text(part) for part in parts))


def _text(node: SyntaxTreeNode) -> str:
    return " ".join(child.content for child in node.children if child.type == "inline") or node.content
