"""One evaluation of data larger than memory: by blocks of time, by components, added up."""
