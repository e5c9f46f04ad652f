"""Many runs of one case: accuracy over cost, where a method fails, what a saving costs."""
