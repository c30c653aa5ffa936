"""Exporters: energy and power for the systems of a plant, over MQTT and OPC UA."""
