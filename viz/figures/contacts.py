"""Contacts: their forces and gaps."""

from __future__ import annotations

import numpy as np

from spacerobot.result import Result
from viz.figures.kind import figure
from viz.figures.style import Drawing, below_last, legend_above, line, panels, styled, until


@figure("Contact forces and gaps", applies=lambda result: "contact" in result.data.dims, place=10)
@styled
def contact_forces(result: Result) -> Drawing:
    """Force along and across the normal, and gap, of each contact: a row for each."""
    data, time = result.data, result.data.time.values
    contacts = [str(contact) for contact in data.contact.values]
    figure, axes = panels(len(contacts), 2, sharex=True, sharey="col")
    for row, contact in zip(axes, contacts, strict=True):
        contact_data = data.sel(contact=contact)
        normal = contact_data.contact_normal_force.values
        size = np.linalg.norm(contact_data.contact_force.values, axis=-1)
        row[0].plot(time, normal, **line(0), label="along the normal")
        across = np.sqrt(np.maximum(size**2 - normal**2, 0))
        if across.any():
            row[0].plot(time, across, **line(1), label="across, by friction")
        row[0].set(title=f"contact {contact}, force", ylabel="force [N]")
        row[1].plot(time, contact_data.contact_gap.values * 1e3, **line(0))
        row[1].axhline(0, color="black", linewidth=0.5)
        row[1].set(title=f"contact {contact}, gap", ylabel="gap [mm]")
        for panel in row:
            panel.set_xlabel("time [s]")
            until(panel, result)
    legend_above(figure, *axes.flat)
    below_last(axes)
    return figure
