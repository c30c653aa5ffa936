"""Identification of friction over speed and motor temperature."""
