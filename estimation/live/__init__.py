"""Live sources, and the page in the browser that shows them."""
