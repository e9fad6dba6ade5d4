"""network, import: pipe networks as files and from other programs', routes, figures, exports."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.text import Text

import omnitrack_sim as ot
from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import (
    JsonOption,
    NetworkArgument,
    PlotOption,
    TrustOption,
    app,
    out,
    plain,
    print_json,
    print_saved,
    print_table,
)

if TYPE_CHECKING:
    from omnitrack_sim.pipes import Route
    from omnitrack_sim.pipes.network import NetworkFitting


ConditionOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Draw relief and couplings into the pipes: good, fair, poor, or a file of rates.",
        autocompletion=complete.conditions,
    ),
]


@app.command()
def network(
    source: Annotated[str | None, NetworkArgument] = None,
    start: Annotated[
        str | None, typer.Option("--from", metavar="PORT", help="Open end a route starts at.")
    ] = None,
    goal: Annotated[
        str | None, typer.Option("--to", metavar="PORT", help="Open end it ends at.")
    ] = None,
    avoid: Annotated[
        list[str] | None,
        typer.Option("--avoid", metavar="FITTING", help="Fitting the route does not enter."),
    ] = None,
    plot: PlotOption = None,
    export: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Write MJCF and STL of the walls and CSV of the centrelines."
        ),
    ] = None,
    random: Annotated[
        int | None,
        typer.Option(
            "--random", metavar="SEED", help="Make a random network instead of reading one."
        ),
    ] = None,
    fittings: Annotated[
        int | None, typer.Option(metavar="N", help="With --random: how many fittings.")
    ] = None,
    to_file: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Write the network: TOML; its centrelines by .geojson; an isometric by .pcf.",
        ),
    ] = None,
    condition: ConditionOption = None,
    as_json: JsonOption = False,
    trust: TrustOption = False,
) -> None:
    """Show a pipe network: parts, open ends, shortest route between two, figures, exports."""
    # A random network may take seconds: places that cannot be written are refused before.
    _check_outputs(to_file, plot, export)
    net = _network(source, random, fittings, condition, trust)
    route = _asked_route(net, start, goal, avoid or [])
    written = _save(net, route, to_file, plot, export)
    if as_json:
        print_json(_summary(net, route))
    else:
        _print_network(net)
        if route is not None:
            _print_route(route)
        for path in written:
            print_saved(path)


@app.command("import")
def import_file(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="A town of EPANET (.inp; extra town), one of wntr's by name, such as ky10, or an "
            "isometric (.pcf).",
            autocompletion=complete.towns,
        ),
    ],
    to_file: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write the network as TOML.")
    ] = None,
    bend_radius: Annotated[
        float | None, typer.Option(metavar="BORES", help="Mean radius of bends; 1.5.")
    ] = None,
    deflection: Annotated[
        float | None,
        typer.Option("--deflection-deg", metavar="DEG", help="Bend of a joint at most; 5."),
    ] = None,
    simplify: Annotated[
        float | None, typer.Option(metavar="M", help="Leave out points off by less; 0.1.")
    ] = None,
    move: Annotated[
        float | None, typer.Option(metavar="M", help="Move nodes at most, to make room; 1.")
    ] = None,
    scale: Annotated[
        float | None, typer.Option(metavar="M", help="Length of a unit of the map.")
    ] = None,
    profile: Annotated[
        str | None,
        typer.Option(help="Of pipes between nodes: even, or level but for one end: low, high."),
    ] = None,
    schedule: Annotated[
        str | None,
        typer.Option(help="ASME B36.10 schedule of true bores: 40, 80, 160 or none."),
    ] = None,
    condition: ConditionOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the draws of --condition.")] = 0,
    as_json: JsonOption = False,
) -> None:
    """Import a network from another program's file; list what was assumed, mended and left out."""
    from omnitrack_sim.base.writing import check_file, write_file

    if to_file is not None:
        check_file(to_file)
    options = {
        "bend_radius": bend_radius,
        "deflection_deg": deflection,
        "simplify": simplify,
        "move": move,
        "scale": scale,
        "profile": profile,
        "schedule": schedule,
    }
    asked = {key: value for key, value in options.items() if value is not None}
    imported = ot.import_network(source, condition=condition, seed=seed, **asked)
    if to_file is not None:
        write_file(to_file, imported.network.to_toml().encode())
    if as_json:
        print_json(imported.summary())
        return
    print_table(("remedy", "where", "what"), [tuple(note) for note in imported.notes])
    parts = f"{len(imported.network.fittings)} parts of {len(imported.lengths)} pipes"
    off = f"{100 * (imported.length_ratio - 1):+.3f} %"
    out.print(f"{parts}, {imported.length:.1f} m of {imported.length_in_file:.1f} m ({off})")
    if to_file is not None:
        print_saved(to_file)


def _check_outputs(to_file: Path | None, plot: Path | None, export: Path | None) -> None:
    """Refuse places that cannot be written, before anything is read or made."""
    from omnitrack_sim.base.writing import check_file, check_folder
    from omnitrack_sim.show.plots.style import figure_format

    if plot is not None:
        figure_format(plot)
    for file in (to_file, plot):
        if file is not None:
            check_file(file)
    if export is not None:
        check_folder(export)


def _network(
    source: str | None,
    seed: int | None,
    fittings: int | None,
    condition: str | None,
    trust: bool,
) -> ot.Network:
    # Exactly one of the two says where the network comes from.
    if (source is None) == (seed is None):
        shipped = tuple(ot.shipped_files("networks"))
        raise NetworkError(Fault("NETWORK", "give a file or name, or --random", shipped))
    if seed is None:
        if fittings is not None:
            raise NetworkError(Fault("--fittings", "is for --random"))
        if condition is not None:
            raise NetworkError(Fault("--condition", "is for --random, and for `omnitrack import`"))
        return ot.load_network(str(source), trust=trust)
    if fittings is None:
        return ot.random_network(seed, condition=condition)
    return ot.random_network(seed, fittings, condition=condition)


def _asked_route(
    net: ot.Network, start: str | None, goal: str | None, avoid: list[str]
) -> Route | None:
    """Plan the route that the options ask for; None where they ask for none."""
    if (start is None) != (goal is None):
        raise NetworkError(Fault("--from, --to", "give both or none", net.open_ends))
    if avoid and start is None:
        raise NetworkError(Fault("--avoid", "is for a route: give --from and --to as well"))
    if start is None or goal is None:
        return None
    # Faults name arguments of the Python function; here they go by the option.
    options = {"start": "--from", "goal": "--to", "avoid": "--avoid"}
    try:
        return ot.shortest_route(net, start, goal, avoid)
    except NetworkError as error:
        raise NetworkError([f.at(options.get(f.where, f.where)) for f in error.faults]) from None


def _text(net: ot.Network, to_file: Path) -> str:
    """Return the contents of a file of the network, by its ending."""
    from omnitrack_sim.pipes.importing.isometric import network_pcf
    from omnitrack_sim.walls.export import network_geojson

    if to_file.suffix.lower() == ".pcf":
        return network_pcf(net)
    if to_file.suffix.lower() in (".geojson", ".json"):
        return network_geojson(net.pipes)
    return net.to_toml()


def _save(
    net: ot.Network,
    route: Route | None,
    to_file: Path | None,
    plot: Path | None,
    export: Path | None,
) -> list[Path]:
    """Write the files that the options ask for, and return their paths."""
    from omnitrack_sim.base.writing import write_file

    if to_file is not None:
        write_file(to_file, _text(net, to_file).encode())
    if plot is not None:
        ot.plot_network(net, path=plot, route=route)
    written = [path for path in (to_file, plot) if path is not None]
    if export is not None:
        from omnitrack_sim.walls.export import export_network

        written += export_network(net.name, net.pipes, export)
    return written


def _summary(net: ot.Network, route: Route | None) -> dict[str, Any]:
    named = {port: name for name, port in net.ports.items()}
    summary: dict[str, Any] = {
        "name": net.name,
        "length_m": net.length,
        "parts": [
            part.model_dump(mode="json")
            | part.fitting().to_table()
            | {
                "ports": {
                    port: net.joined_to.get(f"{part.name}.{port}")
                    for port in net.pipes.parts[i].fitting.port_names
                }
            }
            for i, part in enumerate(net.fittings)
        ],
        "open_ends": [
            {"port": port, "name": named.get(port), "position_m": _position(net, port)}
            for port in net.open_ends
        ],
    }
    if route is not None:
        summary["route"] = {"length_m": route.centreline.length, "fittings": _passages(route)}
    return summary


def _position(net: ot.Network, port: str) -> list[float]:
    index, name = net.end("", port)
    return [float(x) for x in net.pipes.parts[index].port(name).position]


def _passages(route: Route) -> list[dict[str, Any]]:
    return [
        {
            "name": route.network.parts[passage.index].name,
            "manoeuvre": passage.words,
            "enter": passage.enter,
            "leave": passage.leave,
            "from_m": float(passage.s_enter),
            "length_m": float(passage.s_leave - passage.s_enter),
        }
        for passage in route.passages
    ]


def _print_network(net: ot.Network) -> None:
    named = {port: name for name, port in net.ports.items()}
    rows: list[tuple[str | Text, ...]] = []
    for i, part in enumerate(net.fittings):
        for number, port in enumerate(net.pipes.parts[i].fitting.port_names):
            end = f"{part.name}.{port}"
            name = f" ({plain(named[end])})" if end in named else ""
            state = "closed" if port in net.pipes.parts[i].fitting.closed_ports else "open"
            to = net.joined_to.get(end) or Text.from_markup(f"[yellow]{state}[/]{name}")
            head = ("", "", "") if number else (part.name, part.kind, _sizes(part))
            rows.append((*head, port, to))
    print_table(("part", "kind", "sizes", "port", "joined to"), rows)
    ends = ", ".join(f"{end} ({named[end]})" if end in named else end for end in net.open_ends)
    out.say(f"open ends: {plain(ends) or 'none'}")
    out.print(f"{len(net.fittings)} parts, {net.length:.3f} m of axis in all")


def _sizes(part: NetworkFitting) -> str:
    """The sizes of a part, mm and degrees, and how many entries of relief it has of each kind."""
    from collections import Counter

    from omnitrack_sim.base.table import Unit, marks_of

    fitting = part.fitting()
    # Twice the radius in mm; equal bores are named once.
    bores = list(dict.fromkeys(2e3 * fitting.port_radius(port) for port in fitting.port_names))
    sizes = [f"D {' to '.join(f'{bore:.4g}' for bore in bores)} mm"]
    section = fitting.edge(fitting.port_names[-1])
    if section is not None:
        sizes = [f"{section.name} D {1e3 * section.size:.4g} mm"]
    table = fitting.to_table()
    for key, unit in marks_of(fitting.Table, Unit).items():
        if unit.short is not None:
            value = table[key]
            number = f"{1e3 * value:.4g} mm" if unit.symbol == "m" else f"{value:g} {unit.symbol}"
            sizes.append(f"{unit.short} {number}".strip())
    kinds = Counter(str(entry["kind"]) for entry in table.get("relief", ()))
    sizes += [kind if count == 1 else f"{count} x {kind}" for kind, count in kinds.items()]
    sizes += ["measured wall"] if "profile" in table else []
    return ", ".join(sizes)


def _print_route(route: Route) -> None:
    rows = [
        (row["name"], row["manoeuvre"], f"{row['from_m']:.3f}", f"{row['length_m']:.3f}")
        for row in _passages(route)
    ]
    print_table(("passes", "manoeuvre", "from, m", "length, m"), rows)
    out.print(f"route: {route.centreline.length:.3f} m through {len(route.passages)} parts")
