"""What the machine said: columns, readers (one module a format), ingest, cleaning."""
