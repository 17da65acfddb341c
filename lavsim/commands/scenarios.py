"""The hazards a route file may name."""

from __future__ import annotations

from dataclasses import MISSING, fields

from lavsim.commands.base import AsJson, app, print_list, summary_of


@app.command()
def scenarios(as_json: AsJson = False) -> None:
    """List the hazards a route file may name."""
    from lavsim.scenarios.base import SCENARIOS

    entries = []
    for key in SCENARIOS:
        assert isinstance(key, tuple)
        scenario = SCENARIOS[key]
        entries.append(
            {
                "type": key[1],
                "generation": key[0],
                "summary": summary_of(scenario),
                "parameters": {f.name: f.default for f in fields(scenario.Config) if f.default is not MISSING},
            }
        )
    print_list(entries, as_json)
