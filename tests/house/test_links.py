"""Every relative link of every page leads to a file, and to a heading of it where it names one."""

import pytest
from documentation import PAGES, anchors, links, shown


# What a release linked to may have gone since.
@pytest.mark.parametrize("page", PAGES, ids=shown)
def test_links_lead_somewhere(page):
    lost = []
    for link in links(page):
        if link.startswith(("http://", "https://", "mailto:")):
            continue
        place, _, anchor = link.partition("#")
        target = (page.parent / place).resolve() if place else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            lost.append(link)
    assert not lost


def test_pages_and_links_are_found():
    names = {shown(page) for page in PAGES}
    assert {"README.md", "CONTRIBUTING.md", "avc_casadi/README.md", "hardware/README.md", "problems/README.md"} <= names
    assert sum(len(links(page)) for page in PAGES) > 100
