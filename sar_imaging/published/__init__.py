"""Published methods, for comparison; each is imported when `plan_image` is given its name."""
