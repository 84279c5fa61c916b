"""The object's print in the picture: its separation from the dots, registration and tracking."""
