"""Whatever the OpenAPI document allows, and much that it does not: never a 5xx, always an answer as described."""

import pytest
import requests
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.errors import Unsatisfiable
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)
from serving import STREET, running
from shapely import LineString
from street import GEOREFERENCE

from autowaze.world.streets import StreetNetwork, streets

CHECKS = [not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance]
ENDLESS = ("/changes", "/fleet/changes")
NOT_OFFERED = ("/cds/curbs/areas", "/cds/curbs/policies", "/cds/events/status", "/cds/metrics/")


@pytest.fixture(scope="module")
def served(tmp_path_factory, payloads):
    lane = StreetNetwork(GEOREFERENCE, streets([LineString([(0, 0), tuple(100 * STREET.along)])]))
    with running(tmp_path_factory.mktemp("fuzzing") / "cloud.db", streets=lane) as site:
        for payload in payloads:
            assert site.hand_in(payload).status_code == 202
        yield site


def operations(site):
    schema = schemathesis.openapi.from_url(f"{site.url}/openapi.json")
    found = [result.ok() for result in schema.get_all_operations()]
    return [operation for operation in found if operation.path not in ENDLESS]


@pytest.mark.parametrize("mode", [GenerationMode.POSITIVE, GenerationMode.NEGATIVE], ids=["allowed", "not allowed"])
def test_every_route_answers_as_described(served, mode):
    faults = {}
    with requests.Session() as session:
        for operation in operations(served):
            try:
                ask(operation, mode, session)
            except Unsatisfiable:
                assert mode is GenerationMode.NEGATIVE, operation.label  # there is nothing to ask it wrongly
            except (Exception, BaseExceptionGroup) as fault:
                faults[operation.label] = fault
    assert not faults, "\n".join(f"{label}: {fault}" for label, fault in faults.items())


def ask(operation, mode, session):
    @given(case=operation.as_strategy(generation_mode=mode))
    @settings(
        max_examples=10,
        deadline=None,
        database=None,
        derandomize=True,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    def hold(case):
        response = case.call(session=session, timeout=10)
        if operation.path.startswith(NOT_OFFERED):
            assert response.status_code in (501, 400, 406)
        else:
            case.validate_response(response, checks=CHECKS)

    hold()


def test_bad_parameters_are_described_as_they_are_answered(served):
    document = served.client.get("/openapi.json")
    assert "HTTPValidationError" not in document.text
    problem = {"schema": {"$ref": "#/components/schemas/Problem"}}
    for path, route in document.json()["paths"].items():
        for operation in route.values():
            if operation.get("parameters"):
                assert operation["responses"]["400"]["content"]["application/json"] == problem, path


def test_the_document_says_which_routes_ask_for_a_token(served):
    document = served.client.get("/openapi.json").json()
    assert document["components"]["securitySchemes"]["token"]["scheme"] == "bearer"
    routes = [
        (verb, path) for path, route in document["paths"].items() for verb, op in route.items() if "security" in op
    ]
    asking = {
        ("post", "/v1/diffs"),
        ("get", "/map"),
        ("get", "/map/points"),
        ("get", "/fleet"),
        ("put", "/spots/{spot_id}"),
    }
    assert asking <= set(routes)
    assert not {("get", "/spots.geojson"), ("get", "/nearest"), ("get", "/stats")} & set(routes)
