"""Parking maps coming in: GeoJSON, OpenStreetMap extracts, CDS curbs; one file per kind of source."""
