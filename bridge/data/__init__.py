"""What is saved in the .blend or in the preferences: properties, settings and what they mean."""
