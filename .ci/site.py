"""A hook of mkdocs: the documents beside docs/ become pages, and links that leave the documents become plain text."""

import posixpath
import re
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[1]
BESIDE = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md"]
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")


def on_files(files, config):
    for name in BESIDE:
        files.append(File.generated(config, f"project/{name}", content=(ROOT / name).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown, page, config, files):
    """Turns links relative to the repository into links of the site, outside of code, and `rust,no_run` into `rust`."""
    uri = page.file.src_uri
    source = uri.removeprefix("project/") if uri.startswith("project/") else f"docs/{uri}"

    def moved(link):
        mark, text, target = link.groups()
        if "://" in target or target.startswith("#"):
            return link.group()
        path, _, anchor = target.partition("#")
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
        inside = f"project/{path}" if path in BESIDE else path.removeprefix("docs/")
        if inside == path or not files.get_file_from_path(inside):
            return text if (ROOT / path).exists() else link.group()
        target = posixpath.relpath(inside, posixpath.dirname(uri) or ".")
        return f"{mark}[{text}]({target}{'#' + anchor if anchor else ''})"

    parts = re.split(r"(```.*?```)", markdown, flags=re.S)
    code = [re.sub(r"^```(\w+),\S*", r"```\1", part) for part in parts[1::2]]
    text = [LINK.sub(moved, part) for part in parts[::2]]
    return text[0] + "".join(a + b for a, b in zip(code, text[1:], strict=True))
