"""Sources that are followed while they go on, and the page that shows them."""
