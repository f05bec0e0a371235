"""Types that flow between the layers, units, geometry, configuration, clock, events and errors."""
