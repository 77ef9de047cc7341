"""Figures inside a page: SVG that follows the page's colours, PNG as text."""

from __future__ import annotations

import base64
import io
import re

from matplotlib.figure import Figure

from training.figures import svg, write_png
from training.report_page.markup import Markup, element


def chart(name: str, figure: Figure, caption: str) -> Markup:
    """`figure` as inline SVG; black becomes the page's text colour, and ids begin with `name`, as they share a page."""
    drawing = re.sub(r"^.*?(?=<svg)", "", svg(figure), flags=re.DOTALL)
    drawing = re.sub(r"<metadata>.*?</metadata>", "", drawing, flags=re.DOTALL)
    drawing = re.sub(r'\bid="', f'id="{name}-', drawing)
    drawing = re.sub(r'((?:xlink:)?href="#|url\(#)', rf"\g<1>{name}-", drawing)
    drawing = drawing.replace("#000000", "currentColor")
    drawing = re.sub(r"<svg\b", '<svg aria-hidden="true" focusable="false"', drawing, count=1)
    inner = element("div", Markup(drawing), class_="scroll", tabindex="0", role="img", aria_label=caption)
    return element("figure", inner, element("figcaption", caption))


def picture(figure: Figure, caption: str) -> Markup:
    """`figure` as an embedded PNG."""
    file = io.BytesIO()
    write_png(figure, file, dpi=110)
    address = "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()
    return element("figure", element("img", src=address, alt=caption), element("figcaption", caption))
