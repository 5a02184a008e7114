"""The part of the page that moves: what the script fills and drives."""

from retarget.report_page.animation import Animation
from retarget.report_page.markup import Markup, element, joined, safe

__all__ = ["player_section"]

TIMES = "\N{MULTIPLICATION SIGN}"
SPEEDS = (("0.25", f"¼ {TIMES}"), ("0.5", f"½ {TIMES}"), ("1", f"1 {TIMES}"), ("2", f"2 {TIMES}"))


def player_section(animation: Animation | None) -> Markup:
    """Views, controls and the data; nothing for a run that followed nothing."""
    if animation is None:
        return Markup("")
    views = [_view("performer", "Performer", "dots: sensors as measured; lines: reconstructed")]
    if animation.robot is not None:
        sent = "as sent, not as simulated" if animation.simulated else "as sent"
        views.append(
            _view("robot", animation.robot.label, f"circles: landmarks asked; lines: {sent}{_around(animation)}")
        )
    if animation.ground is not None:
        views.append(_view("above", "Balance, from above", "centre of mass over the support polygon; forward is up"))
    every = "every tick is shown" if animation.every == 1 else f"one tick in {animation.every} is shown"
    return element(
        "section",
        element("h2", safe("Motion")),
        element("div", joined(views), class_=f"views of{len(views)}"),
        _controls(),
        element("canvas", id="strip", aria_hidden="true"),
        _legend(animation),
        element("p", safe(f"Drag a body to turn it; {every}."), class_="soft screen"),
        element("script", Markup(animation.as_json()), type="application/json", id="motion"),
        id="player",
    )


def _around(animation: Animation) -> str:
    return "" if animation.obstacles is None else "; thin: obstacles"


def _view(name: str, title: str, caption: str) -> Markup:
    canvas = element("canvas", id=f"view-{name}", role="img", aria_label=f"{title}, animated")
    caption_element = element("figcaption", element("b", safe(title)), element("span", safe(caption)))
    return element("figure", canvas, caption_element, class_=f"view {name}")


def _controls() -> Markup:
    options = joined(
        element("option", safe(label), value=value, selected="" if value == "1" else None) for value, label in SPEEDS
    )
    return element(
        "div",
        element("button", safe("▶ Play"), type="button", id="play"),
        element("input", type="range", id="scrub", min="0", value="0", step="1", aria_label="time"),
        element("output", safe(""), id="clock"),
        element("select", options, id="speed", aria_label="speed"),
        class_="controls",
    )


def _legend(animation: Animation) -> Markup:
    keys = [("approach", "on the way there"), ("follow", "following"), ("brake", "braking")]
    shown = [(name, words) for name, words in keys if name[0] in animation.phase]
    if "1" in animation.gated:
        shown.append(("gated", "the gate changed a goal"))
    if animation.ground is not None and "1" in animation.ground.outside:
        shown.append(("outside", "centre of mass outside"))
    if animation.moments:
        shown.append(("event", "stop or fall"))
    return element("ul", joined(element("li", safe(words), class_=name) for name, words in shown), class_="legend")
