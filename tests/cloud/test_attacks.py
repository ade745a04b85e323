"""What a car, or somebody who has its token, may not do: each attack over HTTP, refused and logged."""

from dataclasses import replace

import numpy as np
import pytest
from serving import NOW, STREET, assert_problem, running

from autowaze.cloud.admission import CarefulAdmission, TimelyAdmission
from autowaze.cloud.store.sources import SourceRegister
from autowaze.cloud.store.tokens import Scope, open_tokens
from autowaze.world.feature_map import MapFeatures
from autowaze.world.identity import feature_ids, instance_keys
from autowaze.world.wire import encode_diff


@pytest.fixture
def now():
    return [NOW]


@pytest.fixture
def town(tmp_path, now):
    """A service that asks for tokens; `now[0]` is its time of day."""
    tokens = open_tokens(tmp_path / "cloud.db", lambda: now[0])
    sources = SourceRegister(tmp_path / "cloud.db", lambda: now[0])
    admit = CarefulAdmission(sources, TimelyAdmission(lambda: now[0]))
    with running(tmp_path / "cloud.db", tokens, admit=admit, received=lambda: now[0]) as site:
        site.tokens, site.sources = tokens, sources
        secrets = {name: tokens.add(name, frozenset({Scope.DIFFS})) for name in ("anna", "berta")}
        secrets["operator"] = tokens.add("operator", frozenset({Scope.OPERATOR}))

        def send(diff, name="anna"):
            payload = diff if isinstance(diff, bytes) else encode_diff(diff)
            return site.hand_in(payload, Authorization=f"Bearer {secrets[name]}")

        site.send, site.secrets = send, secrets
        site.audit = lambda: site.client.get(
            "/audit?limit=1000", headers={"Authorization": f"Bearer {secrets['operator']}"}
        ).json()["entries"]
        yield site
    sources.close()
    tokens.close()


def refused(town, response, reason, status=422, error="diff_refused"):
    """The answer, the counter and the audit log agree."""
    assert_problem(response, status, error)
    assert f'autowaze_diffs_refused_total{{reason="{reason}"}}' in town.client.get("/metrics").text
    assert any(entry["action"] == f"diff refused: {reason}" for entry in town.audit())


def shifted(diff, metres):
    """The same drive elsewhere."""
    offset = np.array([metres, 0.0, 0.0])
    return replace(
        diff,
        new=replace(diff.new, position=diff.new.position + offset),
        ground=replace(diff.ground, ix=diff.ground.ix + round(metres * 4)),
        trajectory=replace(diff.trajectory, position=diff.trajectory.position + offset),
    )


def later(diff, seconds):
    """The same drive at another time."""
    new = diff.new
    return replace(
        diff,
        start=diff.start + seconds,
        end=diff.end + seconds,
        new=replace(new, first_seen=new.first_seen + seconds, last_seen=new.last_seen + seconds),
        trajectory=replace(diff.trajectory, time=diff.trajectory.time + seconds),
    )


def retold(new, session):
    """The same features, as another session would number them."""
    return replace(new, id=feature_ids(session, 0, len(new)), instance_key=instance_keys(session, new.instance_key))


def landmarks(new, away):
    """As many features of what stands, so far away (3,)."""
    nobody = {"label": np.zeros_like(new.label), "instance_key": np.zeros_like(new.instance_key)}
    return replace(new, position=new.position + away, descriptor=np.ones_like(new.descriptor), **nobody)


def of_session(diff, session):
    return STREET.drive(STREET.park([0, 2, 5, 9]), session=session)[diff.sequence]


def test_an_honest_drive_is_taken_in(town, diffs):
    assert [town.send(diff).status_code for diff in diffs] == [202] * len(diffs)
    assert [town.send(diff).status_code for diff in reversed(diffs)] == [200] * len(diffs)
    assert town.durable.store.position == len(diffs)


def test_a_car_with_the_session_of_another(town, diffs):
    town.send(diffs[0])
    refused(town, town.send(diffs[1], "berta"), "foreign_session", 403, "foreign_session")
    refused(town, town.send(diffs[0], "berta"), "foreign_session", 403, "foreign_session")
    assert any(entry["actor"] == "berta" for entry in town.audit())
    assert town.send(diffs[1]).status_code == 202


def test_a_session_belongs_to_its_token_after_a_restart_and_a_rotation(tmp_path, town, diffs):
    town.send(diffs[0])
    town.secrets["anna"] = town.tokens.rotate("anna", grace_s=60.0)
    assert town.send(diffs[1]).status_code == 202
    sources = SourceRegister(tmp_path / "cloud.db", lambda: NOW)
    assert sources.may_use(diffs[0].session, "anna")
    assert not sources.may_use(diffs[0].session, "berta")
    sources.close()


def test_a_replayed_diff_with_other_content(town, diffs):
    town.send(diffs[0])
    refused(town, town.send(replace(diffs[0], position_sigma_m=0.5)), "replayed")
    assert town.send(diffs[0]).status_code == 200


def test_a_replayed_drive_in_a_new_session(town, diffs):
    town.send(diffs[0])
    town.send(diffs[1])
    again = shifted(later(of_session(diffs[0], 2), 1.0), 600.0)
    refused(town, town.send(again), "two_places")


def test_a_back_dated_diff(town, now, diffs):
    town.send(diffs[0])
    refused(town, town.send(later(diffs[1], -300.0)), "back_dated")
    refused(town, town.send(later(diffs[1], 3600.0)), "in_the_future")
    features = replace(diffs[0].new, last_seen=diffs[0].new.last_seen + 600.0)
    refused(town, town.send(replace(diffs[0], session=3, new=retold(features, 3))), "back_dated")
    now[0] += 8 * 86_400.0
    refused(town, town.send(diffs[1]), "too_old")


def test_windows_that_overlap(town, diffs):
    town.send(diffs[0])
    refused(town, town.send(later(diffs[1], -3.0)), "back_dated")
    assert town.send(diffs[1]).status_code == 202


def test_a_diff_from_far_away(town, diffs):
    town.send(diffs[0])
    refused(town, town.send(shifted(diffs[1], 2000.0)), "too_fast")
    refused(town, town.send(shifted(diffs[1], 60_000.0), "berta"), "foreign_session", 403, "foreign_session")
    refused(town, town.send(shifted(of_session(diffs[0], 2), 60_000.0), "berta"), "outside")


def test_what_no_camera_sees(town, diffs):
    diff = diffs[0]
    far = replace(diff.new, position=diff.new.position + np.array([200.0, 0.0, 0.0]))
    refused(town, town.send(replace(diff, new=far)), "too_far")
    refused(town, town.send(replace(diff, ground=replace(diff.ground, ix=diff.ground.ix + 800))), "too_far")
    high = replace(diff.new, position=diff.new.position + np.array([0.0, 0.0, 500.0]))
    refused(town, town.send(replace(diff, new=high)), "too_far")
    refused(town, town.send(replace(diff, new=landmarks(diff.new, np.array([1200.0, 0.0, 0.0])))), "too_far")
    refused(town, town.send(replace(diff, trajectory=diff.trajectory[:0])), "no_path")
    refused(town, town.send(replace(diff, georeference=None)), "no_path")
    refused(town, town.send(replace(diff, end=diff.end + 500.0)), "too_long")
    refused(town, town.send(replace(diff, frames=0, localized_frames=0)), "too_many_features")
    refused(town, town.send(replace(diff, frames=60_000)), "too_many_frames")
    refused(town, town.send(replace(diff, position_sigma_m=400.0)), "unsure")
    assert town.send(diff).status_code == 202


def test_towers_at_the_end_of_a_street_are_taken(town, diffs):
    towers = landmarks(diffs[0].new, np.array([0.0, 470.0, 120.0]))
    assert town.send(replace(diffs[0], new=towers)).status_code == 202


def test_features_that_are_removed_from_afar(town, diffs):
    town.send(diffs[0])
    known = town.durable.service.map.features
    assert len(known)
    robber = replace(shifted(of_session(diffs[1], 5), 1000.0), new=MapFeatures.empty(), removed=known.id)
    refused(town, town.send(robber, "berta"), "too_far")
    assert len(town.durable.service.map.features) == len(known)


def test_a_number_ahead_of_time(town, diffs):
    town.send(diffs[0])
    drive = replace(diffs[1], sequence=2000, new=MapFeatures.empty(), instances=diffs[1].instances[:0])
    refused(town, town.send(drive), "numbering")
    assert town.send(diffs[1]).status_code == 202


def test_one_token_in_two_places_at_once(town, diffs):
    town.send(diffs[0])
    refused(town, town.send(shifted(of_session(diffs[0], 2), 3000.0)), "two_places")
    assert town.send(shifted(of_session(diffs[0], 3), 3000.0), "berta").status_code == 202


def test_a_car_that_starts_again_goes_on(town, now, diffs):
    for diff in diffs:
        town.send(diff)
    again = [later(diff, 120.0) for diff in STREET.drive(STREET.park([1]), session=2)]
    assert [town.send(diff).status_code for diff in again] == [202] * len(again)
    now[0] += 86_400.0  # a day in a garage underground; then far away
    away = [shifted(later(diff, 86_400.0), 8000.0) for diff in STREET.drive(STREET.park([1]), session=3)]
    assert [town.send(diff).status_code for diff in away] == [202] * len(away)


def test_a_tunnel_a_ferry_and_a_gap_in_the_outbox_are_no_lies(town, diffs):
    """A window without position; a stretch at sea; windows that gave way; one that comes late; drift set right."""
    first, second, third = STREET.drive(STREET.park([0]), session=4)[:3]
    assert town.send(first).status_code == 202
    dark = replace(
        second,
        new=second.new[:0],
        ground=second.ground[:0],
        instances=second.instances[:0],
        trajectory=second.trajectory[:0],
    )
    assert town.send(dark).status_code == 202
    assert town.send(shifted(later(replace(third, sequence=40), 600.0), 9000.0)).status_code == 202
    assert town.send(shifted(later(replace(third, sequence=39), 590.0), 8900.0)).status_code == 202


def test_a_flood_of_refusals_does_not_fill_the_audit_log(town):
    for _ in range(300):
        town.send(b"nonsense")
    entries = [entry for entry in town.audit() if entry["action"].startswith("diff refused")]
    assert len(entries) == 1


def test_who_may_read_the_audit_log(town):
    anna = {"Authorization": f"Bearer {town.secrets['anna']}"}
    assert_problem(town.client.get("/audit"), 401, "unauthorized")
    assert_problem(town.client.get("/audit", headers=anna), 403, "forbidden")
    actions = [(entry["actor"], entry["action"]) for entry in town.audit()]
    assert ("", "token added") in actions
    assert ("anna", "forbidden") in actions
    assert not any(secret in str(town.audit()) for secret in town.secrets.values())


def test_tokens_expire_and_rotate(town, now, diffs):
    town.secrets["guest"] = town.tokens.add("guest", frozenset({Scope.DIFFS}), expires_at=NOW + 10.0)
    old = town.secrets["anna"]
    town.secrets["anna"] = town.tokens.rotate("anna", grace_s=5.0)
    town.secrets["anna before"] = old
    assert [town.send(diffs[0], name).status_code for name in ("anna", "anna before")] == [202, 200]
    now[0] += 6.0
    assert_problem(town.send(diffs[0], "anna before"), 401, "unauthorized")
    assert_problem(town.send(diffs[0], "guest"), 403, "foreign_session")
    now[0] += 6.0
    assert_problem(town.send(diffs[0], "guest"), 401, "unauthorized")


def test_nothing_stored_tells_whose_session_it_was_for_longer_than_a_week(tmp_path, town, now, diffs):
    town.send(diffs[0])
    town.send(of_session(diffs[0], 2), "berta")
    today = town.sources.of_session(1)
    assert today == town.sources.of_token("anna")[0]
    now[0] += 86_400.0
    assert town.sources.of_token("anna")[0] != today
    now[0] += 9 * 86_400.0
    town.sources.of_token("anna")
    assert town.sources.of_session(1) is None
    again = SourceRegister(tmp_path / "cloud.db", lambda: now[0])
    assert again.of_session(1) is None
    again.close()
