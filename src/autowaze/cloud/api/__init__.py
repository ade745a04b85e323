"""The service over HTTP: diffs in; spots, map and changes out."""

from autowaze.cloud.api.app import create_app

__all__ = ["create_app"]
