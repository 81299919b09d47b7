"""The report: one offline page for the fleet, one for each machine, for screen and paper."""
