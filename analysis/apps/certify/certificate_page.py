"""A certificate as a page with a picture of the features."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from markupsafe import Markup

from analysis.apps.certify.certificate import Certified
from analysis.apps.certify.certificate_report import answer_of
from analysis.apps.certify.program import Listed
from analysis.apps.report.blocks import Figure
from analysis.apps.report.html_page import answer_page, write_html
from analysis.apps.report.still_chart import Sheet


def write_page(judged: Sequence[Certified], listed: Listed, path: Path, program: str, rig: str) -> None:
    """Write the page. Raises FileError if it cannot be written."""
    picture = Figure("Features from above and from the side", _picture(judged, listed))
    write_html(answer_page(f"Certificate of {program} on {rig}", [*answer_of(judged), picture], "en", boxed=1), path)


def _picture(judged: Sequence[Certified], listed: Listed) -> Markup:
    """Draw the features, coloured by the probability inside the tolerance."""
    sheet, green = Sheet(9.0, 4.2), mpl.colormaps["RdYlGn"]
    panels = sheet.subplots(1, 2)
    for axes, across, name in zip(panels, (1, 2), "yz", strict=True):
        for one in judged:
            if one.now.expected_mm is not None:
                places = listed.work.wanted[one.feature.rows][:, [0, across], 3]
                colour = "0.6" if one.now.probability is None else green(one.now.probability)
                axes.plot(*places.T, "o-", ms=5, color=colour)
                axes.annotate(one.feature.name, np.mean(places, axis=0), fontsize=7)
        axes.set_xlabel("x / mm")
        axes.set_ylabel(f"{name} / mm")
        axes.set_aspect("equal", adjustable="datalim")
    sheet.colorbar(mpl.cm.ScalarMappable(cmap=green), ax=panels, label="probability inside; grey: unknown")
    written = io.BytesIO()
    sheet.savefig(written, format="png", dpi=110)
    image = base64.b64encode(written.getvalue()).decode()
    return Markup('<img alt="" style="max-width:100%" src="data:image/png;base64,{}">').format(image)
