"""MTConnect documents: device models, XML and JSON."""
