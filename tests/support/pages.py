"""What tests of the HTML report share: reading a page as a file, and asking one in a browser."""

import base64
import json
import re
import zlib

import numpy as np
from browser import Browser

NASTY = (
    "<script>alert(1)</script>",
    "\"quotes' & <b>",
    "</script><!--",
    "שלום \u202eabc",
    "a\\nb",
    "u\u2028v\u2029w",
    "&#x27;{{7*7}}",
    "x" * 90,
)


def unpacked(text: str, arrays: list[tuple[str, int]]) -> dict[str, np.ndarray]:
    """What the script makes of the packed text, written anew from the description of `packed`."""
    data = base64.b64decode(text)
    if len(data) < 4 * sum(size for _, size in arrays):
        data = zlib.decompress(data)
    flat = np.frombuffer(data, np.uint8).astype(np.int64)
    found, at = {}, 0
    for name, size in arrays:
        planes = flat[at : at + 4 * size].reshape(4, size)
        code = sum(plane << 8 * k for k, plane in enumerate(planes))
        found[name] = np.cumsum((code >> 1) ^ -(code & 1))
        at += 4 * size
    assert at == len(flat)
    return found


def embedded(html: str) -> dict:
    """The document inside a page."""
    text = re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.S)
    assert text
    return json.loads(text[1])


def address(tab: Browser) -> str:
    return tab.run("decodeURIComponent(location.hash)")


def detail(tab: Browser) -> str:
    return tab.run("document.getElementById('detail').innerText")


def ink(tab: Browser, selector: str) -> int:
    """How many colours a canvas shows."""
    return tab.run(
        f"(() => {{ const c = document.querySelector('{selector}');"
        "const d = new Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height)"
        ".data.buffer); return new Set(d).size; })()"
    )


def picture(tab: Browser) -> str:
    """The plane, when it is drawn."""
    frames = "requestAnimationFrame(() => requestAnimationFrame(() => done(true)))"
    tab.wait(f"new Promise((done) => {frames})")
    return tab.run("document.getElementById('plane').toDataURL()")


def note(tab: Browser) -> str:
    """What is said below the plane."""
    return tab.run("document.getElementById('plane-note').innerText")


def pick(tab: Browser, selector: str, value: str) -> None:
    """Choose an option by its words."""
    tab.run(
        f"(() => {{ const s = document.querySelector('{selector}');"
        f"s.value = [...s.options].find((o) => o.text === '{value}').value;"
        "s.dispatchEvent(new Event('change')); })()"
    )


def texts(tab: Browser, button: str = "[data-do=all]") -> list[tuple[str, float, float]]:
    """All texts of the pictures that a button draws anew, and where they are."""
    path = "CanvasRenderingContext2D.prototype"
    tab.run(
        f"window.said = []; (() => {{ const plain = {path}.fillText; {path}.fillText ="
        " function (...given) { said.push(given); plain.apply(this, given); }; })();"
        f"document.querySelector('{button}').click()"
    )
    tab.wait("said.length > 0")
    return [(text, x, y) for text, x, y in tab.run("said")]


def labels(tab: Browser) -> set[str]:
    """All texts of the pictures, drawn anew."""
    return {text.strip("\u2068\u2069") for text, *_ in texts(tab)}
