"""The pages of the map editor in a real Chromium: each verb by keyboard, two people at once, a killed console."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator

import pytest
from browser import become, become_admin, chromium, until
from console_room import Person, first_admin, invited
from link_processes import ConsoleProcess
from playwright.sync_api import Browser, BrowserContext, Locator, Page, Route, expect

from console.edits import AddPoi, DeleteEdge, DeletePoi, MovePoi, UpdatePoi
from console.server import ConsoleServer

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as running:
        yield running


@pytest.fixture
def failures() -> Iterator[list[str]]:
    """What went wrong in the scripts of any page."""
    found: list[str] = []
    yield found
    assert found == []


def context_of(browser: Browser, url: str) -> BrowserContext:
    context = browser.new_context(base_url=url, viewport={"width": 1200, "height": 800})
    context.set_default_timeout(30_000)
    return context


@pytest.fixture
def page(browser: Browser, server: ConsoleServer, failures: list[str]) -> Iterator[Page]:
    context = context_of(browser, server.ready.url)
    opened = context.new_page()
    opened.on("pageerror", lambda error: failures.append(str(error)))
    become(context, first_admin(server), "Ada")
    yield opened
    context.close()


def open_page(page: Page, path: str) -> None:
    page.goto(path)
    expect(page.locator("body:not([inert])")).to_be_attached()


def press(page: Page, name: str) -> None:
    """Press a button as somebody does who has no mouse."""
    button = page.get_by_role("button", name=name, exact=True).first
    button.focus()
    button.press("Enter")


def form(page: Page, **values: str) -> Locator:
    """Fill in the form that is open, by its labels, with keys alone; return it."""
    dialog = page.get_by_role("dialog")
    for label, value in values.items():
        box = dialog.get_by_label(label.replace("_", " "), exact=True)
        box.focus()
        if box.evaluate("(node) => node.tagName") == "SELECT":
            box.select_option(label=value)
        else:
            page.keyboard.press("Control+a")
            page.keyboard.type(value)
    return dialog


def send(page: Page, **values: str) -> None:
    """Fill in the form, send it with Enter on its button, and see it close."""
    dialog = form(page, **values)
    dialog.locator("button[type=submit]").press("Enter")
    expect(dialog).to_have_count(0)


def tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=re.compile(f"^{name}")).click()


def test_places_are_added_renamed_moved_merged_and_taken_back_by_keys_alone(page: Page, server: ConsoleServer) -> None:
    model = server.services.model
    open_page(page, "/pois")
    page.keyboard.press("Alt+n")
    send(
        page,
        Name="Lift 1",
        Kind="Lift",
        Metres="2",
        From="Hall",
        Towards="Bar",
        Spoken_as="the lift",
        Notes="Two doors.",
    )
    expect(page.get_by_role("row", name=re.compile("Lift 1"))).to_be_visible()
    lift = model.graph.pois["lift-1"]
    assert (lift.x_m, lift.y_m, lift.kind, lift.spoken_name, lift.notes) == (
        pytest.approx(2.0),
        pytest.approx(0.0),
        "lift",
        "the lift",
        "Two doors.",
    )

    press(page, "Edit Lift 1")
    send(page, Name="Lift A")
    assert model.graph.pois["lift-1"].name == "Lift A"
    expect(page.get_by_role("button", name="Edit Lift A")).to_be_focused()

    press(page, "Move Lift A")
    page.get_by_role("dialog").get_by_label("Towards").last.select_option(label="Hall")
    press(page, "1 m away")
    expect(page.get_by_role("dialog")).to_contain_text("Lift A is now at 3.00, 0.00.")
    press(page, "0.1 m towards")
    expect(page.get_by_role("dialog")).to_contain_text("Lift A is now at 2.90, 0.00.")
    page.keyboard.press("Escape")
    press(page, "Move Lift A")
    dialog = form(page, Position="By coordinates")
    dialog.get_by_label("x (metres)").fill("4")
    dialog.get_by_label("y (metres)").fill("1.5")
    dialog.get_by_label("Free position, off the road").press("Space")
    dialog.get_by_role("button", name="Move it").press("Enter")
    expect(dialog).to_have_count(0)
    moved = model.graph.pois["lift-1"]
    assert (moved.x_m, moved.y_m, moved.on_road) == (4.0, 1.5, False)

    model.apply(MovePoi("lift-1", -0.001, 1.5, on_road=False), "Ada")
    expect(page.get_by_role("row", name=re.compile("Lift A"))).to_contain_text(re.compile(r"(?<!-)0\.00"))
    press(page, "Merge Bar")
    send(page, **{"Which place goes?": "Lift A"})
    expect(page.locator("#places tr")).to_have_count(2)
    press(page, "Delete Bar")
    expect(page.locator("#places tr")).to_have_count(1)
    page.locator("h1").click()
    for _ in range(2):
        page.keyboard.press("Control+z")
    expect(page.locator("#places tr")).to_have_count(3)
    page.keyboard.press("Control+Shift+z")
    expect(page.locator("#places tr")).to_have_count(2)


def test_connections_are_proposed_split_changed_and_deleted_by_keys_alone(page: Page, server: ConsoleServer) -> None:
    model = server.services.model
    open_page(page, "/pois#connections")
    press(page, "Delete the connection Hall to Bar")
    expect(page.get_by_text("so nobody can be guided anywhere")).to_be_visible()
    press(page, "Propose connections…")
    expect(page.get_by_role("dialog")).to_contain_text("One connection proposed")
    assert not model.graph.edges
    send(page)
    expect(page.locator("#edges tr")).to_have_count(1)

    press(page, "Split the connection Hall to Bar")
    send(page, **{"Name of the new place": "Corner", "Metres from Hall": "2"})
    expect(page.locator("#edges tr")).to_have_count(2)
    assert model.graph.pois["corner"].x_m == pytest.approx(2.0)

    press(page, "Change the connection Hall to Corner")
    send(page, **{
        "Direction": "Only from Corner to Hall", "Cost": "3", "Width (metres)": "1.1",
        "Caution, walked from Hall to Corner": "On the left",
    })  # fmt: skip
    (edge,) = [one for one in model.graph.edges.values() if {one.a, one.b} == {"a", "corner"}]
    assert (edge.a, edge.b, edge.one_way, edge.cost_multiplier, edge.width_m) == ("corner", "a", True, 3.0, 1.1)
    assert edge.caution_side == "right", "walked the other way, the left is the right"

    page.get_by_label("Closed: Corner to Bar").press("Space")
    until(page, lambda: any(one.closed for one in model.graph.edges.values()), "the connection to be closed")
    expect(page.get_by_label("Closed: Corner to Bar")).to_be_focused()

    press(page, "Connect two places…")
    dialog = form(page, From="Hall", To="Bar")
    expect(dialog).to_contain_text("Hall and Bar are 6.0 m apart along the road.")
    dialog.get_by_role("button", name="Connect").press("Enter")
    expect(page.locator("#edges tr")).to_have_count(3)


def test_connections_that_nobody_was_shown_are_not_accepted(page: Page, server: ConsoleServer) -> None:
    model = server.services.model
    model.apply(DeleteEdge("a-b"), "Bea")
    open_page(page, "/pois#connections")
    press(page, "Propose connections…")
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("One connection proposed")
    model.apply(UpdatePoi("b", notes="By the window."), "Bea")
    model.apply(AddPoi("Lift", "lift", 2.0, 0.0), "Bea")
    dialog.get_by_role("button", name="Accept all").press("Enter")
    expect(dialog).to_contain_text("2 connections proposed")
    expect(dialog).to_contain_text("The draft has been changed meanwhile, and nothing was accepted yet")
    assert not model.graph.edges

    # What changes nothing of what is proposed is no reason to ask again.
    model.apply(UpdatePoi("b", notes="By the door."), "Bea")
    send(page)
    assert {edge.length_m for edge in model.graph.edges.values()} == {2.0, 4.0}


def test_roads_are_drawn_trimmed_smoothed_split_joined_and_deleted_by_keys_alone(
    page: Page, server: ConsoleServer
) -> None:
    model = server.services.model
    open_page(page, "/pois#roads")
    press(page, "Draw a road…")
    dialog = form(page, How="By coordinates")
    dialog.get_by_label("Points (one a line: x, y)").fill("3, 0\nhere")
    dialog.get_by_role("button", name="Draw it").press("Enter")
    expect(dialog.get_by_role("alert")).to_contain_text("Point 2 is not two numbers")
    dialog.get_by_label("Points (one a line: x, y)").fill("3, 0\n3, 4")
    dialog.get_by_role("button", name="Draw it").press("Enter")
    expect(page.locator("#roads tr")).to_have_count(2)

    press(page, "Trim Road 2")
    send(page, **{"to (metres from its beginning)": "3"})
    expect(page.get_by_role("row", name=re.compile("Road 2"))).to_contain_text("3.0 m")
    press(page, "Smooth Road 1")
    send(page, **{"Over how many metres": "0.5"})
    press(page, "Split Road 2")
    send(page, **{"Metres from its beginning": "1"})
    expect(page.locator("#roads tr")).to_have_count(3)
    press(page, "Join Road 2")
    send(page, **{"The other road": "Road 3, 2.0 m"})
    expect(page.locator("#roads tr")).to_have_count(2)
    press(page, "Delete Road 2")
    expect(page.locator("#roads tr")).to_have_count(1)
    assert list(model.graph.roads) == ["r1"]
    press(page, "Delete Road 1")
    expect(page.locator("#toasts")).to_contain_text("Hall")
    assert list(model.graph.roads) == ["r1"]


def other_person(browser: Browser, server: ConsoleServer, failures: list[str]) -> Page:
    """Bea, an editor, in a browser of her own. Ada is signed in already."""
    ada = Person(server.ready.url)
    ada.sign_in("Ada").raise_for_status()
    context = context_of(browser, server.ready.url)
    become(context, invited(ada, "Bea", "editor"), "Bea")
    opened = context.new_page()
    opened.on("pageerror", lambda error: failures.append(str(error)))
    return opened


def test_two_people_see_each_other_and_a_conflict_shows_both_versions(
    page: Page, browser: Browser, server: ConsoleServer, failures: list[str]
) -> None:
    model = server.services.model
    bea = other_person(browser, server, failures)
    open_page(page, "/pois")
    open_page(bea, "/pois")
    expect(page.locator("#also-here")).to_contain_text("Bea, in the tables")

    # Bea types a name; meanwhile Ada renames the same place, and sees that Bea is at it.
    press(bea, "Edit Bar")
    form(bea, Name="Coffee bar")
    expect(page.get_by_role("row", name=re.compile("^Bar"))).to_contain_text("Bea edits")
    press(page, "Edit Bar")
    send(page, Name="Tea bar")
    expect(bea.locator("#places")).to_contain_text("Tea bar")
    expect(bea.get_by_role("dialog").get_by_label("Name")).to_have_value("Coffee bar")

    bea.keyboard.press("Enter")
    both = bea.get_by_role("dialog", name="Two versions")
    expect(both.get_by_role("row", name=re.compile("^Name"))).to_contain_text("Coffee bar")
    expect(both.get_by_role("row", name=re.compile("^Name"))).to_contain_text("Tea bar")
    expect(both).to_contain_text("Theirs: Ada")
    bea.keyboard.press("Escape")
    expect(bea.get_by_role("dialog").get_by_role("alert")).to_contain_text("Nothing was saved yet")
    expect(bea.get_by_role("dialog").get_by_label("Name")).to_have_value("Coffee bar")
    assert model.graph.pois["b"].name == "Tea bar"
    bea.get_by_role("button", name="Save").press("Enter")
    both.get_by_role("button", name="Use mine").press("Enter")
    expect(bea.get_by_role("dialog")).to_have_count(0)
    expect(page.locator("#places")).to_contain_text("Coffee bar")
    assert model.graph.pois["b"].name == "Coffee bar"

    # Deleted under her hands: hers can no longer be made, and what she typed is still there.
    press(bea, "Edit Coffee bar")
    form(bea, Notes="By the window.")
    press(page, "Delete Coffee bar")
    expect(bea.locator("#places tr")).to_have_count(1)
    bea.get_by_role("button", name="Save").press("Enter")
    expect(both).to_contain_text("By the window.")
    expect(both.get_by_role("button", name="Use mine")).to_be_disabled()
    both.get_by_role("button", name="Keep theirs").press("Enter")
    expect(bea.get_by_role("dialog")).to_have_count(0)
    bea.context.close()
    expect(page.locator("#also-here")).to_be_hidden()


def test_an_edit_of_somebody_else_takes_no_focus_and_no_typed_text(page: Page, server: ConsoleServer) -> None:
    open_page(page, "/pois")
    page.keyboard.press("/")
    page.keyboard.type("ba")
    expect(page.locator("#places tr")).to_have_count(1)
    server.services.model.apply(UpdatePoi("b", name="Bar one"), "Bea")
    expect(page.locator("#places")).to_contain_text("Bar one")
    page.keyboard.type("r")
    expect(page.get_by_label("Search").first).to_have_value("bar")
    page.get_by_label("Search").first.fill("")
    page.get_by_role("button", name="Move Hall").focus()
    page.evaluate("for (const row of document.querySelectorAll('#places tr')) row.cells[0].drawnBefore = true")
    server.services.model.apply(UpdatePoi("a", name="Zoo hall"), "Bea")
    expect(page.locator("#places tr").last).to_contain_text("Zoo hall")
    expect(page.get_by_role("button", name="Move Zoo hall")).to_be_focused()
    kept = page.evaluate("[...document.querySelectorAll('#places tr')].map((row) => Boolean(row.cells[0].drawnBefore))")
    assert kept == [True, False], "only the row that differs is drawn anew"


def test_a_name_that_another_place_has_is_asked_about_before_it_is_saved(page: Page, server: ConsoleServer) -> None:
    model = server.services.model
    open_page(page, "/pois")
    press(page, "Edit Bar")
    dialog = form(page, Name="hall ")
    dialog.get_by_role("button", name="Save").press("Enter")
    asked = page.get_by_role("dialog", name="Two places of one name?")
    expect(asked).to_contain_text("Another place is called Hall: a walker could not tell them apart.")
    asked.get_by_role("button", name="Change the name").press("Enter")
    expect(dialog.get_by_role("alert")).to_contain_text("give this one another name")
    assert model.graph.pois["b"].name == "Bar"
    dialog.get_by_role("button", name="Save").press("Enter")
    asked.get_by_role("button", name="Save all the same").press("Enter")
    expect(page.get_by_role("dialog")).to_have_count(0)
    assert model.graph.pois["b"].name == "hall"
    press(page, "Edit hall")
    send(page, Notes="The same name is no reason to ask again.")

    # The list beside the scene asks as well.
    open_page(page, "/")
    page.get_by_role("tab", name="Places").click()
    press(page, "Rename hall")
    page.get_by_label("New name of hall").fill("Bar")
    page.get_by_label("New name of hall").press("Enter")
    until(page, lambda: model.graph.pois["b"].name == "Bar", "the name to be saved")
    press(page, "Rename Bar")
    page.get_by_label("New name of Bar").fill("Hall")
    page.get_by_label("New name of Bar").press("Enter")
    asked.get_by_role("button", name="Change the name").press("Enter")
    expect(page.get_by_label("New name of Bar")).to_have_value("Hall")
    assert model.graph.pois["b"].name == "Bar"


def test_a_page_on_which_something_was_typed_is_not_left_unasked(page: Page) -> None:
    # What a browser does before it leaves a page; it asks where the event was stopped.
    leaves = "dispatchEvent(new Event('beforeunload', { cancelable: true }))"
    open_page(page, "/pois")
    press(page, "Edit Bar")
    assert page.evaluate(leaves), "nothing was typed yet"
    form(page, Name="Tea bar")
    assert not page.evaluate(leaves)
    send(page)
    until(page, lambda: page.evaluate(leaves), "nothing to be left to ask about once it was sent")


def test_versions_are_named_compared_gone_back_to_and_published(page: Page, server: ConsoleServer) -> None:
    model = server.services.model
    model.apply(UpdatePoi("b", name="Tea bar"), "Ada")
    open_page(page, "/versions")
    expect(page.locator("#difference")).to_contain_text("Name: Bar → Tea bar")
    model.apply(MovePoi("b", 5.84, 0.0), "Ada")
    expect(page.locator("#difference")).to_contain_text("moved by 0.16 m")
    model.apply(MovePoi("b", 5.998, 0.0), "Ada")
    expect(page.locator("#difference")).to_contain_text("One thing lies elsewhere by less than a centimetre.")
    expect(page.locator("#difference")).to_have_text(re.compile("Changed: 1Place Tea bar *Name: Bar → Tea bar"))
    press(page, "Name the draft…")
    send(page, Name="Before the summer")
    expect(page.locator("#named")).to_contain_text("Before the summer")
    named = model.graph.version
    model.apply(DeletePoi("b"), "Bea")
    expect(page.locator("#difference")).to_contain_text("Removed: 2")
    expect(page.locator("#history")).to_contain_text("Deleted Tea bar")
    press(page, f"Go back to version {named}")
    until(page, lambda: "b" in model.graph.pois, "the version to be back")
    expect(page.locator("#history")).to_contain_text(f"Went back to version {named}")
    page.locator("h1").click()
    page.keyboard.press("Control+z")
    until(page, lambda: "b" not in model.graph.pois, "going back to be taken back")
    page.get_by_role("button", name="Publish").press("Enter")
    until(page, lambda: model.published == model.graph, "the draft to be published")
    expect(page.locator("#steps")).to_contain_text("is published")


def test_bad_files_are_refused_beside_the_field_and_change_nothing(page: Page, server: ConsoleServer) -> None:
    before = server.services.model.graph
    open_page(page, "/exchange")
    press(page, "Look at it")
    expect(page.locator("#graph-problem")).to_have_text("Choose a file first.")
    expect(page.get_by_label("File").first).to_be_focused()
    for content in (b"", b"\x00\xff{", b'{"type": "FeatureCollection", "features": 3}'):
        page.get_by_label("File").first.set_input_files({"name": "bad.geojson", "mimeType": "", "buffer": content})
        press(page, "Look at it")
        expect(page.locator("#graph-problem")).not_to_be_empty()
        expect(page.locator("#graph-file")).to_have_attribute("aria-invalid", "true")
    assert server.services.model.graph == before

    # A good one is shown first, made at one stroke, and taken back at one.
    good = page.request.get("/api/export/graph.geojson").body().replace(b'"Bar"', b'"Tea bar"')
    page.get_by_label("File").first.set_input_files({"name": "good.geojson", "mimeType": "", "buffer": good})
    press(page, "Look at it")
    expect(page.get_by_role("heading", name="What good.geojson would change")).to_be_focused()
    expect(page.locator("#preview")).to_contain_text("Name: Bar → Tea bar")
    assert server.services.model.graph == before

    # What was said of one file goes when another one is chosen: what is imported is the file that stands in the field.
    page.get_by_label("File").first.set_input_files({"name": "bad.geojson", "mimeType": "", "buffer": b"{"})
    expect(page.locator("#preview")).to_be_hidden()
    press(page, "Look at it")
    expect(page.locator("#graph-problem")).not_to_be_empty()
    expect(page.locator("#preview")).to_be_hidden()
    page.get_by_label("File").first.set_input_files({"name": "good.geojson", "mimeType": "", "buffer": good})
    expect(page.locator("#graph-problem")).to_be_empty()
    press(page, "Look at it")
    expect(page.get_by_role("heading", name="What good.geojson would change")).to_be_focused()
    press(page, "Import it")
    expect(page.locator("#toasts")).to_contain_text("good.geojson is imported")
    assert server.services.model.graph.pois["b"].name == "Tea bar"
    press(page, "Undo")
    until(page, lambda: server.services.model.graph.pois == before.pois, "the import to be taken back")


def test_an_import_says_before_it_is_made_what_it_deletes_and_what_is_to_be_looked_at(
    page: Page, server: ConsoleServer
) -> None:
    model = server.services.model
    whole = page.request.get("/api/export/graph.geojson").body()
    point = {
        "type": "Feature",
        "properties": {"name": "Kiosk"},
        "geometry": {"type": "Point", "coordinates": [3.0, 0.0]},
    }
    foreign = json.dumps({"type": "FeatureCollection", "features": [point]}).encode()
    open_page(page, "/exchange")
    expect(page.locator("#exports-differ")).to_be_hidden()
    model.apply(AddPoi("Lift", "lift", 2.0, 0.0), "Bea")
    expect(page.locator("#exports-differ")).to_have_text(re.compile("The draft is version 2; site.zip holds version 1"))
    field = page.get_by_label("File").first
    warned = page.locator("#preview .note.warn")

    field.set_input_files({"name": "whole.geojson", "mimeType": "", "buffer": whole})
    press(page, "Look at it")
    expect(warned).to_contain_text("whatever is not in it is deleted (one thing here)")
    expect(page.locator("#preview")).to_contain_text("Place Lift")
    press(page, "Leave it")
    field.set_input_files({"name": "foreign.geojson", "mimeType": "", "buffer": foreign})
    press(page, "Look at it")
    expect(warned).to_have_count(1)
    expect(warned).to_contain_text("The file does not say where it lies")
    expect(page.locator("#preview")).to_contain_text(re.compile("Place Kiosk *at 3.00, 0.00"))
    far = foreign.replace(b"[3.0, 0.0]", b"[11.57, 148.14]")
    field.set_input_files({"name": "far.geojson", "mimeType": "", "buffer": far})
    press(page, "Look at it")
    expect(warned.last).to_contain_text("Kiosk lies more than 50 m from every road and place of this map")
    assert "Lift" in {poi.name for poi in model.graph.pois.values()}


def test_a_site_whose_import_nobody_answered_is_made_once_when_it_is_asked_again(
    page: Page, server: ConsoleServer
) -> None:
    archive = page.request.get("/api/export/site.zip").body()
    kept: list[str] = []

    def without_answer(route: Route) -> None:
        # A browser does not show to whoever listens what is in a file that it sends.
        kept.append(route.fetch(post_data=archive).json()["site"])
        route.abort()

    def choose() -> None:
        page.locator("#site-file").set_input_files({"name": "site.zip", "mimeType": "", "buffer": archive})

    open_page(page, "/exchange")
    page.route("**/api/import/site", without_answer)
    choose()
    page.locator("#site-send").press("Enter")
    expect(page.locator("#site-problem")).to_contain_text("The console does not answer")
    page.unroute("**/api/import/site")
    page.locator("#site-send").press("Enter")
    expect(page.locator("#site-done")).to_contain_text(kept[0])
    sites = server.services.builds.folder
    assert [str(site.resolve()) for site in sites.iterdir()] == kept
    # Whoever has heard the answer and asks again means another one.
    choose()
    page.locator("#site-send").press("Enter")
    expect(page.locator("#site-done")).not_to_contain_text(f"{kept[0]} ")
    until(page, lambda: len(list(sites.iterdir())) == 2, "another site")


def test_what_was_confirmed_outlives_a_killed_console_and_the_page_goes_on(
    browser: Browser, console: ConsoleProcess, failures: list[str]
) -> None:
    context = context_of(browser, f"http://127.0.0.1:{console.port}")
    page = context.new_page()
    page.on("pageerror", lambda error: failures.append(str(error)))
    become_admin(page, console.first_link)
    open_page(page, "/pois")
    press(page, "Edit Bar")
    send(page, Name="Tea bar")
    press(page, "Edit Hall")
    dialog = form(page, Name="Great hall")
    console.kill()
    expect(page.locator("#link-banner")).to_contain_text("No connection")
    page.keyboard.press("Enter")
    expect(dialog.get_by_role("alert")).to_contain_text("The console does not answer")
    expect(dialog.get_by_label("Name")).to_have_value("Great hall")
    console.start()
    expect(page.locator("#link-banner")).to_be_hidden()
    expect(dialog.get_by_role("alert")).to_have_count(0)
    dialog.get_by_role("button", name="Save").press("Enter")
    expect(dialog).to_have_count(0)
    page.reload()
    expect(page.locator("#places")).to_contain_text("Tea bar")
    expect(page.locator("#places")).to_contain_text("Great hall")
    # Done, but nobody hears the answer: saved again, it is done once.
    versions: list[int] = []

    def without_answer(route: Route) -> None:
        versions.append(route.fetch().json()["version"])
        route.abort()

    page.route("**/api/edits*", without_answer)
    press(page, "Edit Great hall")
    dialog = form(page, Name="Small hall")
    page.keyboard.press("Enter")
    expect(dialog.get_by_role("alert")).to_contain_text("The console does not answer")
    page.unroute("**/api/edits*")
    assert len(versions) > 1
    assert len(set(versions)) == 1, "asked again and again, and done once"
    context.close()
