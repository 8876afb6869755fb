"""From raw channels to samples: channels derived, samples set aside, and implausible units."""
