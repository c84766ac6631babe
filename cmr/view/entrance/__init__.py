"""Who comes in to the page, what they may send, and how fast they may guess; it knows neither robots nor pages."""
