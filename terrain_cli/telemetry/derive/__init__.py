"""From raw channels to samples: what is derived, what is set aside, what is hardly true."""
