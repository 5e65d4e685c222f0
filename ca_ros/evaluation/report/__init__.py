"""One page of HTML from the folders of the studies and the benchmark."""
