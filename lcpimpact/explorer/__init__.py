"""One page that runs problems in the browser: the steps of linear methods as JavaScript, with the bits of Python."""
