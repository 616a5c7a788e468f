"""3-D scene, plots and event log in Chromium, with what the fake live module tells them."""

import numpy as np
import pytest

POSE = [10.0, 5.0, 2.0, 0.0, 0.0, np.pi / 2]  # north, east, depth; heads east


@pytest.fixture(scope="module")
def page(browser, console_url):
    """All three views, the setup and plan of the lawn-mower, one state; what goes wrong is on `page.wrong`."""
    from tests.console.served.conftest import wait_for

    url, process = console_url
    wait_for(f"{url}/all", process)
    context = browser.new_context(viewport={"width": 1000, "height": 1200})
    page, wrong = context.new_page(), []
    page.on("console", lambda message: wrong.append(message.text) if complains(message) else None)
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("request", lambda asked: None if asked.url.startswith((url, "blob:", "data:")) else wrong.append(asked.url))
    page.wrong = wrong
    opened(page, f"{url}/all")
    yield page
    context.close()


def complains(message):
    """Whether a line of the browser's console is a complaint; not that its compositor waited for WebGL in software."""
    return message.type == "error" or (message.type == "warning" and "GPU stall due to ReadPixels" not in message.text)


def opened(page, url):
    page.goto(url)
    page.wait_for_selector("#events button")
    page.wait_for_selector("#scene3d canvas")
    page.wait_for_selector("#plots summary")
    page.evaluate("fake.emit('setup', fake.SETUP); fake.emit('plan', fake.PLAN); fake.emit('state', fake.stateAt(1))")


def emit(page, **changes):
    page.evaluate("changes => fake.emit('state', {...fake.stateAt(changes.t ?? 1), ...changes})", changes)


def pictures(page, view="scene3d"):
    return int(page.evaluate(f"document.querySelector('#{view}').dataset.pictures ?? 0"))


# The 3-D scene.


def bow(page, eta):
    """Where the scene shows bow, starboard side and keel of a vehicle at eta, less CO, in three.js's axes."""
    return np.array(
        page.evaluate(
            """async eta => {
              const {World} = await import('/static/scene3d_world.js');
              const {THREE} = await import('nicegui-scene');
              const world = new World(() => {});
              world.setState({...fake.stateAt(1), eta});
              world.root.updateMatrixWorld(true);
              const at = p => world.vehicle.localToWorld(new THREE.Vector3(...p));
              const middle = at([0, 0, 0]);
              return [middle, ...[[1, 0, 0], [0, 1, 0], [0, 0, 1]].map(p => at(p).sub(middle))].map(p => p.toArray());
            }""",
            list(eta),
        )
    )


def test_scene_shows_north_away_east_right_and_depth_below(page):
    middle, ahead, starboard, keel = bow(page, POSE)
    np.testing.assert_allclose(middle, [5.0, -2.0, -10.0])
    np.testing.assert_allclose([ahead, starboard, keel], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)


def test_scene_turns_the_vehicle_as_euler_angles_say(page):
    from rovtwin.core.frames import rotation_from_euler

    euler = np.array([0.3, -0.4, 2.1])
    found = bow(page, [*POSE[:3], *euler])[1:].T
    shown_n = np.array([[0, 1, 0], [0, 0, -1], [-1, 0, 0]])  # x north to -z, y east to x, z down to -y
    np.testing.assert_allclose(found, shown_n @ np.asarray(rotation_from_euler(euler)), atol=1e-12)


def test_ellipsoid_is_that_of_the_covariance(page):
    covariance = np.array([[0.04, 0.015], [0.015, 0.09]])
    found = page.evaluate(
        "async c => (await import('/static/scene3d_parts.js')).ellipse(c, Math.sqrt(7.815))", covariance.tolist()
    )
    variances, axes = np.linalg.eigh(covariance)
    np.testing.assert_allclose(found["axes"], np.sqrt(7.815 * variances[::-1]))
    along = [np.cos(found["angle"]), np.sin(found["angle"])]
    assert abs(along @ axes[:, 1]) == pytest.approx(1.0)


def test_track_is_bounded_and_goes_back_with_time(page):
    count, t, ends, back = page.evaluate(
        """async () => {
          const {Trail} = await import('/static/scene3d_parts.js');
          const trail = new Trail(0.05);
          for (let i = 0; i <= 30000; i++) trail.add(0.1 * i, [0.06 * i, 0, 1]);
          const ends = [0, trail.count - 1].map(i => trail.at.getX(i));
          const seen = [trail.count, trail.t[trail.count - 1], ends];
          trail.add(100.05, [60, 0, 1]);
          return [...seen, trail.t[trail.count - 2]];
        }"""
    )
    assert count <= 4096
    assert t == pytest.approx(3000.0)
    assert ends == pytest.approx([0.0, 1800.0], rel=1e-6)
    assert back <= 100.05


def test_scene_draws_what_changes_and_nothing_else(page):
    page.wait_for_function("Number(document.querySelector('#scene3d').dataset.pictures) > 0")
    page.wait_for_timeout(300)  # whatever was still to be loaded
    before = pictures(page)
    for _ in range(5):
        page.evaluate("fake.emit('state', {...fake.stateAt(1), t: 1, late_ms: 3})")
    page.wait_for_timeout(200)
    assert pictures(page) == before, "nothing to be seen has changed"
    emit(page, eta=POSE)
    page.wait_for_function(f"Number(document.querySelector('#scene3d').dataset.pictures) > {before}")


def test_scene_says_what_it_shows(page):
    emit(page, eta=POSE, sd=[0.1, 0.1, 0.01, 0, 0, 0], ellipse=[[0.01, 0.0], [0.0, 0.01]])
    page.get_by_text("95 % within ±0.28 × ±0.28 × ±0.03 m").wait_for()
    assert "floor 8.0 m" in page.locator("#scene3d .scene3d-words").inner_text()


def test_follow_goes_along_with_the_vehicle(page):
    page.get_by_role("button", name="Follow the vehicle").click()
    assert page.get_by_role("button", name="Follow the vehicle").get_attribute("aria-pressed") == "true"
    assert page.get_by_role("button", name="Turn about a fixed place").get_attribute("aria-pressed") == "false"
    page.get_by_role("button", name="Show everything").click()
    assert page.get_by_role("button", name="Follow the vehicle").get_attribute("aria-pressed") == "false"


# Plots.


def words(page, name):
    return page.locator("#plots figure", has=page.locator(f"b:text-is('{name}')")).locator(".plots-words").inner_text()


def test_plots_show_values_in_units_of_people(page):
    eta = [0.0, 0.0, 3.5, 0.0, 0.0, -np.pi / 2]
    emit(page, t=1.1, eta=eta, sd=[0, 0, 0.01, 0, 0, 0.01], reference=[0, 0, 3.25, 0, 0, -1.5], truth=None)
    page.wait_for_function("document.querySelector('#plots .plots-words').innerText.includes('3.50')")
    assert words(page, "Depth").split() == ["3.50", "3.25", "±", "0.020", "m"]
    assert words(page, "Heading").split() == ["270.0", "274.1", "±", "1.12", "°"]
    assert words(page, "Surge speed u").split()[-1] == "m/s"


def test_body_velocity_is_compared_with_the_reference_in_the_body_frame(page):
    from rovtwin.core.frames import euler_rate_matrix, rotation_from_euler

    euler, rate = np.array([0.2, -0.3, 2.0]), np.array([0.4, -0.2, 0.1, 0.03, -0.05, 0.2])
    found = page.evaluate(
        """async ([eta, rate]) => {
          const {channels} = await import('/static/plots_channels.js');
          const state = {...fake.stateAt(1), eta, reference_rate: rate};
          return [...'uvwpqr'].map(id => channels(null, state).find(c => c.id === id).lines(state).reference);
        }""",
        [[0.0, 0.0, 1.0, *euler], rate.tolist()],
    )
    expected = np.concatenate(
        [np.asarray(rotation_from_euler(euler)).T @ rate[:3], np.linalg.solve(euler_rate_matrix(euler), rate[3:])]
    )
    np.testing.assert_allclose(found, expected * np.repeat([1.0, 180 / np.pi], 3), rtol=1e-9)


def test_sensors_are_plotted_with_the_units_of_the_table(page):
    found = page.evaluate(
        """async () => {
          const {channels} = await import('/static/plots_channels.js');
          const setup = {readings: {pressure: {fields: ['depth'], units: ['m']}}};
          const state = {...fake.stateAt(1), sensors: {pressure: {age: 0, value: [2]}, other: {age: 0, value: [1, 2]}}};
          return channels(setup, state).filter(c => c.id.startsWith('sensor_')).map(c => [c.name, c.unit]);
        }"""
    )
    assert found == [["Sensor pressure, depth", "m"], ["Sensor other, 1", ""], ["Sensor other, 2", ""]]


def test_ring_buffers_keep_ten_minutes_and_no_more(page):
    size, oldest, newest, after, slow = page.evaluate(
        """async () => {
          const {Store, ROOM} = await import('/static/plots_store.js');
          const store = new Store();
          const z = [{id: 'z', lines: s => ({value: s.t})}];
          for (let k = 0; k < 40000; k++) store.add({t: 0.05 * k, eta: []}, z);
          const read = i => store.column('z', 'value')[i % ROOM];
          const seen = [store.column('z', 'value').length, read(store.first), read(store.count - 1)];
          store.add({t: 1900, eta: []}, z);
          const after = [store.newest, read(store.count - 1), read(store.count - 2)];
          const before = store.count;
          for (let k = 1; k <= 100; k++) store.add({t: 1900 + 0.001 * k, eta: []}, z);
          return [...seen, after, store.count - before];
        }"""
    )
    assert 12000 <= size <= 20000
    assert newest == pytest.approx(1999.95) and 600 <= newest - oldest <= 0.05 * size
    assert after == pytest.approx([1900.0, 1900.0, 1899.95]), "time that goes back takes away what came after"
    assert slow <= 2, "time that runs slowly does not fill the buffer"


def test_pause_holds_the_plots_and_the_cursor_reads_them(page):
    page.evaluate("for (let t = 2; t < 20; t += 0.05) fake.emit('state', {...fake.stateAt(t), nu: [t, 0, 0, 0, 0, 0]})")
    page.wait_for_function("document.querySelector('#plots').innerText.includes('19.95')")
    page.get_by_role("button", name="Hold the plots").click()
    emit(page, t=25.0, nu=[25.0, 0, 0, 0, 0, 0])
    canvas = page.get_by_role("img", name="Surge speed u over time")
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    plotted = box["width"] - 60  # less the numbers of the axis
    canvas.hover(position={"x": 52 + plotted * (10.0 - (19.95 - 30)) / 30, "y": box["height"] / 2})
    page.wait_for_function("document.querySelector('#plots time').innerText === 'at 0:10'")
    assert float(words(page, "Surge speed u").split()[0]) == pytest.approx(10.0, abs=0.11)
    page.mouse.move(0, 0)
    page.wait_for_function("document.querySelector('#plots time').innerText === ''")
    assert words(page, "Surge speed u").startswith("19.95"), "held"
    page.get_by_role("button", name="Hold the plots").click()
    page.wait_for_function("document.querySelector('#plots').innerText.includes('25.00')")


def test_plots_are_drawn_ten_times_a_second_at_most(page):
    before = pictures(page, "plots")
    page.evaluate(
        """() => new Promise(done => {
          let t = 30;
          const timer = setInterval(() => fake.emit('state', fake.stateAt(t += 0.05)), 5);
          setTimeout(() => { clearInterval(timer); done(); }, 600);
        })"""
    )
    assert 1 <= pictures(page, "plots") - before <= 7


# The event log.


def happen(page, *events):
    page.evaluate("events => events.forEach(e => fake.emit('event', {kind: 'event', ...e}))", list(events))


def event(k, level="info", text=None):
    return {"t": float(k), "clock": f"12:00:{k % 60:02d}", "level": level, "text": text or f"event {k}"}


def test_events_are_newest_first_and_distinguished_by_level(page):
    happen(page, event(1), event(2, "danger", "<img src=x onerror=alert(1)>"), event(3, "warning"))
    happen(page, event(2, "danger", "<img src=x onerror=alert(1)>"))  # sent again after a lost connection
    rows = page.locator("#events li")
    rows.nth(2).wait_for()
    assert rows.all_inner_texts()[0].split("\n")[-1] == "event 3"
    assert rows.count() == 3 and rows.nth(1).get_attribute("class") == "danger"
    assert page.locator("#events img").count() == 0, "texts are texts"
    page.get_by_role("button", name="Hide info").click()
    assert [row.is_visible() for row in rows.all()] == [True, True, False]
    page.get_by_role("button", name="Show info").click()
    assert rows.nth(2).is_visible()


def test_events_are_kept_to_five_hundred(page):
    happen(page, *(event(k) for k in range(10, 620)))
    page.get_by_text("event 619").wait_for()
    assert page.locator("#events li").count() == 500
    assert page.locator("#events li span").first.inner_text() == "event 619"


# All of them.


def test_every_control_has_a_name(page):
    nameless = page.evaluate(
        """[...document.querySelectorAll('main :is(button, input, summary, canvas, section, [tabindex])')]
          .filter(e => !e.closest('[aria-hidden=true]') && !e.getAttribute('aria-label') && !e.closest('label')
            && !(e.tagName === 'BUTTON' && e.innerText.trim()))
          .map(e => e.outerHTML.slice(0, 80))"""
    )
    assert nameless == []


def test_chosen_channels_are_remembered(page, console_url):
    page.locator("#plots summary").click()
    page.get_by_role("checkbox", name="Thruster sway").check()
    page.get_by_role("checkbox", name="Depth m", exact=True).uncheck()
    page.get_by_role("button", name="Show the last 2 min").click()
    opened(page, f"{console_url[0]}/all")
    names = page.locator("#plots figcaption b")
    assert names.all_inner_texts() == ["Heading", "Surge speed u", "Distance from reference", "Thruster sway"]
    assert page.get_by_role("button", name="Show the last 2 min").get_attribute("aria-pressed") == "true"


def test_nothing_went_wrong_and_nothing_was_asked_of_others(page):
    assert page.wrong == []
